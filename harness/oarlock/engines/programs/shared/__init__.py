"""What programs share. ``launch.py`` puts the folder of the programs last on ``sys.path``."""
