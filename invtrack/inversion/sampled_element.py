"""One hold of a linear plant: what comes out of it for a constant input, and the discrete inverse that meets the outputs in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.hold_coordinates import HoldCoordinates
from invtrack.inversion.hold_response import HoldResponse
from invtrack.inversion.nonlinear.elements import ElementMaps

LEAST_GAP = 0.3
"""Least |log |lambda|| of the modes of the sampled inverse that stand for no zero with which it is taken."""


@dataclass(frozen=True, eq=False)
class SampledElement:
    """q_end = exact q + push y_d, u = gain y_d - back q for the state q at the start of a hold and outputs y_d met within it.

    Args:
        coordinates: in which the state is q.
        length: of the hold [s].
        shares: of it after which each output is met (p,).
        responses: of the state after each of these shares, and at the end.
        exact, push: (n, n) and (n, p).
        back, gain: (m, n) and (m, p).
    """

    coordinates: HoldCoordinates
    length: float
    shares: Array
    responses: Mapping[float, HoldResponse]
    exact: Array
    push: Array
    back: Array
    gain: Array

    @classmethod
    def of(cls, coordinates: HoldCoordinates, length: float, at_end: tuple[bool, ...]) -> SampledElement:
        """The element, each output met at its end or in its middle. Raises LinAlgError where the input acts on no output in it."""
        A, B, C, D = coordinates.A, coordinates.B, coordinates.C, coordinates.D
        shares = np.where(at_end, 1.0, 0.5)
        responses = {share: HoldResponse.of(A, B, length, share) for share in (1.0, *shares.tolist())}
        out_q = np.array([C[i] @ responses[share].start for i, share in enumerate(shares.tolist())])
        out_u = np.array([C[i] @ responses[share].held + D[i] for i, share in enumerate(shares.tolist())])
        end = responses[1.0]
        maps = ElementMaps(end.start[None], end.held[None], out_q[None], out_u[None])
        back, gain = (each[0] for each in maps.inverse)
        return cls(coordinates, length, shares, responses, maps.exact[0], end.held @ gain, back, gain)

    def lasting(self, length: float) -> SampledElement:
        """The same for a hold of another length [s]. Raises LinAlgError where the input acts on no output in it."""
        return self.of(self.coordinates, length, tuple((self.shares == 1.0).tolist()))

    def changes(self, departure: Array) -> tuple[Array, Array]:
        """Of q at the end (k, n), and of each output where it is met (k, p), by departures (6, k, m) of k inputs at the nodes."""
        C, D, n = self.coordinates.C, self.coordinates.D, len(self.exact)
        outputs = [
            self.responses[share].change(C[i : i + 1], D[i : i + 1], departure) for i, share in enumerate(self.shares.tolist())
        ]
        return self.responses[1.0].change(np.eye(n), np.zeros((n, D.shape[1])), departure), np.hstack(outputs)
