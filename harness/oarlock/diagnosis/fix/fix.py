"""One file with everything that helps a model, and what it does: tried before it is written, and checked afterwards.

The closed pose goes into the keyframe that the start came from, so that the numbers of keyframes stay; a model without
any gets its first one, where ``check`` then starts by itself. Where nothing helps, the file is a copy of the model, so
that whatever reads it next finds it.

Where the start contradicts a coupling, either the pose or the constant of its polynomial is off: ``offsets`` has the
rule; ``relposes`` that of welds. Settings are taken out again where the fixed file's own check has an error that they
do not mend: ``claims``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from difflib import SequenceMatcher
from itertools import zip_longest
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError, few
from oarlock.base.numbers import finite
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.edit.changes import Change, Keyframe
from oarlock.diagnosis.edit.copy import write_copies
from oarlock.diagnosis.edit.place import require_place
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.fix.choice import Choice
from oarlock.diagnosis.fix.claims import MENDED, claims, hidden, in_words, mended, standing
from oarlock.diagnosis.fix.search import choose_changes, described, take_settings_out
from oarlock.diagnosis.fix.words import drifts, opens, overrun, overruns
from oarlock.diagnosis.runs.trials import Setting, Start, Trial
from oarlock.diagnosis.verdict.answer import unsettled
from oarlock.diagnosis.verdict.findings import Finding
from oarlock.diagnosis.verdict.verdicts import judge


@dataclass(frozen=True)
class Changed:
    """A change of a fix.

    Attributes:
        what: in words.
        without, with_it: runs from the file's own start: of settings with all others, of others before the settings.
    """

    what: str
    without: Trial
    with_it: Trial

    def __str__(self) -> str:
        said = f"{self.what}: {drifts(self.without)} → {drifts(self.with_it)} under {self.with_it.label}"
        beyond = overruns(self.without, self.with_it)
        return f"{said}; {beyond}" if beyond else said


@dataclass(frozen=True)
class Line:
    """A line of a file that a fix changed.

    Attributes:
        file: the copy.
        number: of the line in the source; of one that is new, of the line before it.
        before, after: the line; None: there is none.
    """

    file: str
    number: int
    before: str | None
    after: str | None


def changed_lines(source: Path, copy: Path) -> Iterator[Line]:
    """What a copy has otherwise, line by line."""
    before, after = (path.read_bytes().decode(errors="replace").splitlines() for path in (source, copy))
    for kind, a, b, c, d in SequenceMatcher(None, before, after, autojunk=False).get_opcodes():
        if kind != "equal":
            for place, (was, now) in enumerate(zip_longest(before[a:b], after[c:d])):
                yield Line(copy.name, min(a + place, b - 1) + 1, was, now)


@dataclass(frozen=True)
class Fix:
    """What a fixed file is, and what it does.

    Attributes:
        file: it.
        written: all files that were written: copies of changed included or attached files, and it.
        lines: of them that are other ones than in the model.
        changes: what changed; empty: it is a copy of the model as it was.
        left_out: what was tried and did not help, in words.
        target: wanted drift, m or rad.
        before: the model as it was, under the user's controls from its own start.
        after: the fixed file, the same way.
        elsewhere_before, elsewhere: the same two under random controls.
        begins: where the fixed file's own check starts, in words.
        mended: codes of errors and warnings that were there before, and are not any more.
        left: errors and warnings of the fixed file's own check, as ``oarlock check`` gives them.
        by_hand: what its own check puts first and no settings mend: its code, name and element, and what is said of
            it; empty where there is none.
        reason: what stands in the way, in a sentence; empty where the target is reached, all claims are kept and
            nothing is left that comes first.
        elsewhere_reason: the same of random controls.
    """

    file: Path
    written: tuple[Path, ...]
    lines: tuple[Line, ...]
    changes: tuple[Changed, ...]
    left_out: tuple[str, ...]
    target: float
    before: Trial
    after: Trial
    elsewhere_before: tuple[Trial, ...]
    elsewhere: tuple[Trial, ...]
    begins: str
    mended: tuple[str, ...]
    left: tuple[Finding, ...]
    by_hand: tuple[str, str] | tuple[()]
    reason: str
    elsewhere_reason: str = ""

    @property
    def reached(self) -> bool:
        """Whether the file holds the target under the user's controls, and nothing is left that comes before that."""
        return not self.reason

    def told(self) -> Iterator[str]:
        """The fix in words, line by line."""
        if not self.changes:
            why = "nothing that was tried helps" if not self.reached else "nothing that was tried mends what is left"
            yield f"{why if self.left or not self.reached else 'nothing to fix'}: {self.file} is the model as it was"
        for one in self.changes:
            yield f"changed  {one}"
        for said in self.left_out:
            yield f"left out  {said}"
        yield f"drift  {_before_and_after(self.before, self.after)}; target {self.target:g}"
        yield f"start  {self.begins}"
        for was, trial in zip(self.elsewhere_before, self.elsewhere, strict=True):
            yield f"drift  {_before_and_after(was, trial)}"
        if self.mended:
            yield f"mended  {few(list(self.mended))}"
        for finding in self.left:
            of = f"{finding.element}: " if finding.element else ""
            yield f"left  {finding.severity} {finding.code} {finding.name}  {of}{finding.line}"
        if self.by_hand:
            yield "not fixed  {}, by hand: {}".format(*self.by_hand)
        if codes := dict.fromkeys(one.code for one in self.left if one.code not in MENDED):
            explained = few([f"`oarlock explain {code}`" for code in codes])
            yield f"left to you, for nothing is written for it: see {explained}"
        for said in filter(None, (self.reason, self.elsewhere_reason)):
            yield f"not reached  {said}"
        for path in self.written[:-1]:
            yield f"wrote  {path}"

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "file": str(self.file),
            "written": [str(path) for path in self.written],
            "changes": [
                {
                    "what": one.what,
                    "drift_without": finite(one.without.drift),
                    "drift_with": finite(one.with_it.drift),
                    "unit": one.with_it.unit,
                    "controls": one.with_it.label,
                    "overrun": _overrun_figures(one.without, one.with_it),
                }
                for one in self.changes
            ],
            "lines": [asdict(one) for one in self.lines],
            "left_out": list(self.left_out),
            "target": self.target,
            "drift_before": finite(self.before.drift),
            "drift": finite(self.after.drift),
            "unit": self.after.unit,
            "controls": self.after.label,
            "overrun": _overrun_figures(self.before, self.after),
            "elsewhere": [
                {
                    "controls": trial.label,
                    "drift_before": finite(was.drift),
                    "drift": finite(trial.drift),
                    "unit": trial.unit,
                    "overrun": _overrun_figures(was, trial),
                }
                for was, trial in zip(self.elsewhere_before, self.elsewhere, strict=True)
            ],
            "begins": self.begins,
            "mended": list(self.mended),
            "left": [finding.document() for finding in self.left],
            "by_hand": list(self.by_hand),
            "reached": self.reached,
            "reason": self.reason,
            "elsewhere_reason": self.elsewhere_reason,
        }


def _before_and_after(was: Trial, now: Trial) -> str:
    beyond = overruns(was, now)
    said = f"{drifts(was)} before, {drifts(now)} after, under {now.label}"
    return f"{said}; {beyond}" if beyond else said


def _overrun_figures(was: Trial, now: Trial) -> dict[str, Any] | None:
    """The limit that is overrun otherwise than before, for JSON."""
    found = overrun(was, now)
    if found is None:
        return None
    before, after = found
    return {"limit": after.limit, "before": before.by, "after": after.by, "unit": after.unit}


def fix_model(exam: Examination, findings: Sequence[Finding], out: Path) -> Fix:
    """Writes one file with everything that helps a model, and checks it.

    Args:
        exam: the examination of the model, complete.
        findings: of the examination.
        out: the file; what is there is replaced.

    Raises:
        InputError: the model is no MJCF file, or ``out`` is the model itself or cannot be written.
    """
    require_place(exam.path, out)
    if exam.states is not None:
        raise InputError("a fix is tried by runs of the model, expected no log of states (--states)")
    bench = Bench.of(exam)
    choice = choose_changes(bench)
    again = _checked(bench, choice, findings, out)
    if (wrong := standing(again.left)) and take_settings_out(bench, choice, in_words(wrong)):
        first = again.written
        again = _checked(bench, choice, findings, out)
        for path in first.keys() - again.written.keys():  # a copy of an included file that needs no change now
            path.unlink(missing_ok=True)
    start, setting = Start(again.exam.qpos, again.exam.qvel, again.exam.act, "file"), Setting.authored(again.exam.model)
    after = bench.run_model(again.exam.model, setting, start)
    elsewhere = tuple(bench.run_model(again.exam.model, setting, start, seed) for seed in bench.seeds)
    first = unsettled(again.exam, again.found)
    by_hand = (in_words([first[0]]), first[1]) if first is not None else ()
    return Fix(
        file=out,
        written=tuple(again.written),
        lines=tuple(line for path, source in again.written.items() for line in changed_lines(source, path)),
        changes=tuple(_changed(bench, change, choice) for change in choice.changes),
        left_out=tuple(choice.left_out),
        target=bench.target,
        before=choice.before,
        after=after,
        elsewhere_before=tuple(bench.run([], seed) for seed in bench.seeds),
        elsewhere=elsewhere,
        begins=again.exam.begins,
        mended=mended(findings, choice.changes, again.found),
        left=again.left,
        by_hand=by_hand,
        reason=_reason(bench, choice, after, again.left) or (f"{by_hand[0]} is left to you" if by_hand else ""),
        elsewhere_reason=_elsewhere(bench.target, elsewhere),
    )


@dataclass(frozen=True)
class _Checked:
    """A fixed file as it was written.

    Attributes:
        written: what was written → what it is a copy of.
        exam: its own check.
        found: what that found, and what of the model it only does not see.
    """

    written: dict[Path, Path]
    exam: Examination
    found: tuple[Finding, ...]

    @property
    def left(self) -> tuple[Finding, ...]:
        """The errors and warnings."""
        return tuple(one for one in self.found if one.severity != "note")


def _checked(bench: Bench, choice: Choice, findings: Sequence[Finding], out: Path) -> _Checked:
    """Writes the file and checks it."""
    written = write_copies(bench.base.path, out, choice.changes)
    again = _begun(bench, choice.changes, out)
    for _ in examine(again):
        pass
    found = judge(again, bench.exam.options.fail_above)
    return _Checked(written, again, (*found, *hidden(bench, choice.changes, findings, found)))


def _begun(bench: Bench, changes: Sequence[Change], out: Path) -> Examination:
    """The fixed file's own check, begun as its user will: the settings that were asked for are in the file by now."""
    exam = bench.exam
    keyframe = exam.options.keyframe
    new = next((one.name for one in changes if isinstance(one, Keyframe) and one.key is None), None)
    if new is not None and (keyframe is not None or bench.base.model.nkey):
        keyframe = new
    asked = replace(exam.options, keyframe=keyframe, timestep=None, integrator=None, budget=0.0, fail_above=None)
    again = begin(str(out), asked)
    if exam is not bench.base:  # a case says itself what drives it
        again.laws, again.driven = exam.laws, exam.driven
    return again


def _changed(bench: Bench, change: Change, choice: Choice) -> Changed:
    return Changed(described(bench, change, choice), *choice.effects[id(change)])


def _reason(bench: Bench, choice: Choice, after: Trial, left: Sequence[Finding]) -> str:
    """Why the file does not hold the target, or is not mended, in a sentence; empty where it is."""
    said = []
    if after.drift > bench.target:
        said.append(opens(after) + (f": {why}" if (why := _why_open(bench, choice)) else ""))
    if errors := [one for one in left if one.severity == "error"]:
        said.append(f"{in_words(errors)} {'stays' if len(errors) == 1 else 'stay'}")
    if said:
        return "; ".join(said)
    unmended = [one for one in left if any(claims(bench, change, one) for change in choice.changes)]
    return f"its own check still says {few([f'{one.code} {one.name}' for one in unmended])}" if unmended else ""


def _why_open(bench: Bench, choice: Choice) -> str:
    exam = bench.exam
    if not choice.closed:
        return "no pose near the start closes the loops"
    if exam.options.budget <= 0:
        return "no settings were looked for"
    if choice.recipe is not None and not choice.recipe.reached:
        return choice.recipe.reason
    return exam.missing.get("remedy", "")


def _elsewhere(target: float, trials: Sequence[Trial]) -> str:
    beyond = [one for one in trials if one.drift > target]
    if not beyond:
        return ""
    worst = max(beyond, key=lambda one: one.drift)
    return f"under {worst.label} {opens(worst)}"
