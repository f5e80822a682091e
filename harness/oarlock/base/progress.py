"""How work that takes a while is listened to."""


class Progress:
    """Listens to a run, a suite or a check. This one keeps silent; a subclass overrides what it wants to hear."""

    def begin(self, what: str, total: int, kept: int = 0) -> None:
        """Work begins.

        Args:
            what: the kind of work, such as ``running``.
            total: how much of it there is: steps of a run, units of a suite, parts of a check.
            kept: how much of that is done already.
        """

    def advance(self, count: int) -> None:
        """So much of the work was done."""

    def note(self, text: str) -> None:
        """Something that is worth knowing while the work goes on, in one line."""

    def finished(self, label: str, seconds: float | None = None, message: str = "") -> None:
        """Something with a name is finished.

        Args:
            label: its name.
            seconds: how long it took, where that was measured, s.
            message: why it is not as it should be; empty if it is.
        """
