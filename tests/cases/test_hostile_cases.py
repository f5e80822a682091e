"""Case files that would take for ever, wait for ever or fill the memory: one line each, at once."""

import os
import time

import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError, load_case
from oarlock.cases.truth import load_truth

AT_ONCE_S = 10.0
TRUTH = '[truth]\njoint = "crank"\nsource = "x"\nfile = '
EXPERIMENT = '[[experiments]]\nmode = "free"\n'
CASES = {
    "digits": (f"[parameters]\nN = {'9' * 5000}", "4300 digits"),
    "arrays": (f"tags = {'[' * 1000}{']' * 1000}", "nested too deeply"),
    "deeper": (f"tags = {'[' * 100_000}{']' * 100_000}", "nested too deeply"),
    "keys": (f"{'.'.join(['a'] * 5000)} = 1", "a key of more than 64 parts"),
    "quoted": (".".join(['"a b"'] * 5000) + " = 1", "a key of more than 64 parts"),
    "header": (f"[{'.'.join(['a'] * 200_000)}]", "a key of more than 64 parts"),
    "settings": (f"{EXPERIMENT}settings = []", "at least 1 item"),
    "solvers": (f"{EXPERIMENT}solvers = []", "at least 1 item"),
    "sweep": ("[sweep]\ntimesteps_s = [1e-3, 2e-3]\nsettings = []", "at least 1 item"),
    "experiments": (EXPERIMENT * 5000, "at most 1000 items"),
    "size": ("# " + "x" * 2**22, "expected 4194304 at most"),
    "nul": (f'{TRUTH}"a\\u0000b"', "cannot read the truth"),
    "pipe": (f'{TRUTH}"pipe"', "is not a regular file"),
    "device": (f'{TRUTH}"/dev/zero"', "is not a regular file"),
    "step": (f'{TRUTH}"zero.csv"', "rising times"),
}


@pytest.mark.parametrize("kind", list(CASES))
def test_one_line_at_once(tmp_path, kind):
    text, said = CASES[kind]
    folder = write_model(tmp_path / "case", four_bar(), f'title = "x"\n{text}\n').parent
    os.mkfifo(folder / "pipe")
    rows = "".join(f"{time_s},0,0,0\n" for time_s in ("0", "1e-300", "2"))
    (folder / "zero.csv").write_text(f"time,position,velocity,acceleration\n{rows}")
    began = time.monotonic()
    with pytest.raises(InputError, match=said) as caught:
        load_truth(load_case(folder))
    assert time.monotonic() - began < AT_ONCE_S
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_case_file_is_no_pipe(tmp_path):
    folder = write_model(tmp_path / "case", four_bar()).parent
    os.mkfifo(folder / "case.toml")
    with pytest.raises(InputError, match=r"holds no case\.toml"):
        load_case(folder)
