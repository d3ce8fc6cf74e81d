r"""The board is moved: carried to another desk, turned over, picked up at the end of a night.

For half a minute it turns by tens of degrees a second, and gravity comes from elsewhere. These rows
tell nothing of the noise, and with their share of the record in the mean square a motion of a
thousand times the noise hides everything else. It is found in time, as a shock is, and on all axes
together, by blocks of a second that scatter *and* whose means jump (`moved_rows`); it lasts for
eight seconds or more, and its rows are taken out as those of a shock are. A new attitude is one
step of each accelerometer, in the middle of it. What moves for more than a quarter of the record is
not at rest, and is left as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from allanscope.explain.effects.shock import Shock


@dataclass(frozen=True)
class Motion(Shock):
    """One motion."""

    kind = "motion"
    meaning = "the board is moved for longer than a shock"
    phrase = "motion at {event}, up to {peak}"
    is_motion = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "shock": "is over within eight seconds",
        "variance_change": "is a few times stronger than the rest, and its means stay",
        "excursion": "stays at another level, as quiet as before",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        seconds = f"{self.duration.value:.2g} s"
        if self.end:
            return f"motion of up to {self.peak.text} in the {self.end} {seconds}, removed"
        return f"motion of up to {self.peak.text} at {self.time.value:.1f} s for {seconds}, removed"
