"""What lightly damped modes leave in a plan's input after its manoeuvre."""

from __future__ import annotations

from dataclasses import dataclass

LEVEL = 0.01
"""Share of its peak from which on an input counts as acting, unless another is asked for."""


@dataclass(frozen=True)
class Ringing:
    """Lightly damped modes in the input after a manoeuvre.

    Args:
        frequency: |s| of the one that lasts longest [rad/s].
        damping: its damping ratio.
        share: amplitude of all of them at the end of the manoeuvre, as a share of the input's peak.
        duration: how long after the manoeuvre the input stays more than `LEVEL` of its peak away from rest [s].
    """

    frequency: float
    damping: float
    share: float
    duration: float

    @property
    def remark(self) -> str:
        """What it means, in a sentence."""
        return (
            f"after the manoeuvre the input rings on at {self.frequency:.3g} rad/s (damping ratio {self.damping:.2g}): "
            f"{self.share:.2g} of its peak at T_f, above {100 * LEVEL:g} % of it for another {self.duration:.4g} s; a smoother or "
            "longer reference excites that less"
        )
