"""``python -m oarlock``."""

from oarlock.cli.app import main

if __name__ == "__main__":
    main()
