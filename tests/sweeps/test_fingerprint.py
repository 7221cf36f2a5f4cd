"""The hash of a study: the same in another process, another one as soon as anything changes that the rows depend on."""

from __future__ import annotations

import functools
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.errors import FileError, SweepError
from invtrack.sweeps.fingerprint import study_hash

STUDY = """
import functools
from {helper} import scale

LIMIT = 3.0

def study(point, seed, factor=1.0):
    return {{"value": scale(point["a"]) * factor}}
"""


@dataclass(frozen=True)
class Settings:
    names: frozenset[str]
    gains: Any

    @cached_property
    def largest(self) -> float:
        return float(np.max(self.gains))


def of(*parts: Any) -> str:
    return study_hash(parts, [])


def in_a_process(folder: Path, expression: str) -> str:
    program = (
        f"import functools, numpy, study; from invtrack.sweeps.fingerprint import study_hash; print(study_hash([{expression}], []))"
    )
    environment = {"PYTHONPATH": f"{folder}:{Path(invtrack.__file__).parents[1]}"}
    return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True).stdout


def write(folder: Path, study: str = STUDY, helper: str = "def scale(a):\n    return 2 * a\n") -> None:
    (folder / "study.py").write_text(study.format(helper="helper_of_study"))
    (folder / "helper_of_study.py").write_text(helper)


def test_another_process_finds_the_same_hash_and_a_changed_text_another_one(tmp_path: Path) -> None:
    write(tmp_path)
    bound = "functools.partial(study.study, factor={'b': {'x', 'y', 'z'}, 'a': numpy.arange(3.0)})"
    first = in_a_process(tmp_path, bound)
    assert in_a_process(tmp_path, bound) == first
    write(tmp_path, STUDY.replace("LIMIT = 3.0", "LIMIT = 4.0"))
    constant = in_a_process(tmp_path, bound)
    write(tmp_path, helper="def scale(a):\n    return 3 * a\n")
    imported = in_a_process(tmp_path, bound)
    assert len({first, constant, imported}) == 3


def test_arguments_count_by_their_values() -> None:
    first = Settings(frozenset({"a", "b", "c"}), np.array([1.0, 2.0]))
    again = Settings(frozenset({"c", "b", "a"}), np.array([1.0, 2.0]))
    assert again.largest == 2.0  # what is computed from the others once and kept is no value of its own
    assert of(functools.partial(of, first)) == of(functools.partial(of, again))
    others = [
        replace(first, gains=np.array([1.0, np.nextafter(2.0, 3.0)])),
        replace(first, gains=np.array([[1.0, 2.0]])),
        replace(first, gains=[1.0, 2.0]),
        replace(first, names=frozenset({"a", "b"})),
    ]
    assert len({of(settings) for settings in [first, *others]}) == 5
    assert len({of(value) for value in (1, 1.0, True, "1", None, -0.0, 0.0, b"1", [1], (1,))}) == 10


def test_shared_and_circular_parts_are_taken_as_what_they_hold() -> None:
    shared = [1.0]
    assert of([shared, shared]) == of([[1.0], [1.0]])
    circular: list[Any] = [1.0]
    circular.append(circular)
    assert of(circular) != of([1.0, [1.0]])


def test_functions_without_a_file_count_by_their_code_and_what_they_use() -> None:
    def defined(text: str) -> Any:
        names: dict[str, Any] = {"__name__": "nowhere"}
        exec(text, names)
        return names["study"]

    text = "gain = 2.0\ndef inner(a):\n    return a + 1\ndef study(point, seed):\n    return {'a': gain * inner(point['a'])}\n"
    first = of(defined(text))
    assert of(defined("# moved\n" + text)) == first
    assert len({first, of(defined(text.replace("2.0", "3.0"))), of(defined(text.replace("a + 1", "a + 2")))}) == 3


def test_closures_and_lambdas_in_one_place_are_told_apart() -> None:
    pair = [lambda a: a + 1, lambda a: a + 2]
    assert of(pair[0]) != of(pair[1])
    assert of((lambda gain: lambda a: a * gain)(2)) != of((lambda gain: lambda a: a * gain)(3))


def test_a_plan_can_be_bound_to_a_study() -> None:
    model = invtrack.StateSpace([[0.0, 1.0], [-40.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]])
    plans = [invtrack.invert(model, invtrack.rest_to_rest(0.0, 1.0, duration=duration)) for duration in (1.0, 1.0, 1.1)]
    hashes = [of(functools.partial(of, plan)) for plan in plans]
    assert hashes[0] == hashes[1] != hashes[2]


def test_files_count_by_their_content(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text("<mujoco/>")
    first = study_hash([None], [path])
    path.write_text("<mujoco></mujoco>")
    assert study_hash([None], [path]) != first
    with pytest.raises(FileError, match="on which the study depends"):
        study_hash([None], [tmp_path / "missing.xml"])


def test_what_cannot_be_compared_between_processes_is_refused() -> None:
    plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
    with pytest.raises(SweepError, match=r"got .* in it, which has no pickle .*; make it in the function given as prepare"):
        of(functools.partial(of, plant))
