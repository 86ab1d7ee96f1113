"""A problem is a value: what is solved, sent to workers and stored is what it says, whatever it was made from."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from conftest import ELASTIC, RIGID, SLIDER_ELASTIC, SLIDER_RIGID, task

import pkmsea
from pkmsea.errors import InputError, Unreachable
from pkmsea.problem import Problem, build_problem, task_of
from pkmsea.solution import Solution, solve
from pkmsea.solution.store import changed as changed_on_disk
from pkmsea.solution.store import load
from pkmsea.solver import multistart
from pkmsea.solver.spread import _built, spread
from pkmsea.study.jobs import PointJob, crashed, run
from pkmsea.study.pool import Pool
from pkmsea.task import Limits, OperatingPoint, Payload, Spline, Task, TaskLimits
from pkmsea.transcription import Transcription, transcribe
from pkmsea.transcription.default import FlatTranscription

SAME = 1e-9  # relative: of one problem, solved in different processes
QUICK = {"trajectory": {"kind": "fourier", "order": 8}, "starts": 2}
SHORT = 200  # characters of a repr
SMALL = 100_000  # bytes of a pickled problem: it goes with every call


@pytest.fixture(scope="module")
def slider() -> Problem:
    return build_problem(task("linear_axis_1", SLIDER_ELASTIC, options=QUICK))


@pytest.fixture(scope="module")
def changed(slider: Problem) -> Problem:
    """Ten times the friction, and slower: no file says so."""
    drives = [drive.model_copy(update={"friction": 10 * drive.friction}) for drive in slider.drives]
    return replace(slider, drives=drives, cycle=slider.cycle.model_copy(update={"period": 2.5}))


@pytest.fixture(scope="module")
def solved(changed: Problem) -> Solution:
    return solve(changed, workers=1)


def test_it_follows_its_fields(slider: Problem, changed: Problem) -> None:
    assert changed.actuation.drives[0].friction == 10 * slider.actuation.drives[0].friction
    assert changed.mechanism is slider.mechanism
    fast = replace(slider, limits=TaskLimits(end_effector=Limits(velocity=3.0), urdf=False))
    assert [(b.quantity, b.upper) for b in fast.bounds] == [("dr_E", 3.0)]
    loaded = replace(slider, payload=Payload(mass=1.5, pick=1, place=2))
    mass = replace(loaded, cycle=changed.cycle).actuation.payload
    assert loaded.actuation.payload is not None and mass is not None
    assert (loaded.actuation.payload.period, mass.period) == (2.0, 2.5)  # type: ignore[attr-defined]


def test_it_refuses_what_does_not_fit(slider: Problem) -> None:
    """Without a file; keys are paths from the problem."""
    arms = build_problem(task("pkm_2rrr", RIGID))
    far = arms.cycle.model_copy(update={"points": (arms.cycle.points[0], OperatingPoint(at=(9.0, 0.0), window=1e-3))})
    unknown = TaskLimits(joints=Limits(position={"nobody": (0, 1)}))
    faults: list[tuple[Problem, dict[str, Any], type[InputError], str]] = [
        (arms, {"cycle": far}, Unreachable, "cycle.points.1.at"),
        (arms, {"cycle": slider.cycle}, InputError, "cycle.points"),
        (arms, {"drives": arms.drives * 2}, InputError, "drives"),
        (arms, {"payload": Payload(mass=1, pick=1, place=3)}, InputError, "payload"),
        (arms, {"limits": unknown}, InputError, "limits.joints"),
        (arms, {"name": "a\nb"}, InputError, "name"),
    ]
    for problem, change, kind, key in faults:
        with pytest.raises(kind) as caught:
            replace(problem, **change)
        assert (caught.value.file, caught.value.key) == (None, key)


def test_it_pickles_as_it_is(changed: Problem, solved: Solution) -> None:
    """A copy is equal, small, and of the same mechanism, so that nothing is built again for it."""
    content = pickle.dumps(changed)
    copy = pickle.loads(content)
    assert copy == changed and copy.mechanism is changed.mechanism
    assert len(content) < SMALL and pickle.dumps(changed) == content
    assert pickle.loads(pickle.dumps(solved)).energy == pytest.approx(solved.energy, rel=SAME)


def test_a_worker_builds_it_once(changed: Problem) -> None:
    content = pickle.dumps(transcribe(changed))
    first = _built(content)
    assert _built(pickle.dumps(transcribe(changed))) is first
    other = _built(pickle.dumps(transcribe(replace(changed, name="other"))))
    assert other is not first and other.problem.mechanism is first.problem.mechanism


def counted(transcription: Transcription, _: int) -> tuple[int, str, int]:
    """The process, and what it has built so far."""
    import os

    from pkmsea.actuation.equations import stage_functions

    return os.getpid(), transcription.problem.name, stage_functions.cache_info().misses


def test_workers_share_what_is_built_for_a_mechanism(changed: Problem) -> None:
    """Two problems of one mechanism, several calls each: a process builds the stage functions once."""
    misses: dict[int, set[int]] = {}
    for name in ("one", "two"):
        problem = replace(changed, name=name)
        for pid, what, count in spread(transcribe(problem), 2, [(counted, i) for i in range(6)]):
            assert what == name
            misses.setdefault(pid, set()).add(count)
    assert len(misses) == 2
    assert all(len(counts) == 1 for counts in misses.values()), misses


def test_two_workers_solve_the_changed_problem(slider: Problem, changed: Problem, solved: Solution) -> None:
    assert solve(changed, workers=2).energy == pytest.approx(solved.energy, rel=SAME)
    assert abs(solve(slider, workers=2).energy / solved.energy - 1) > 0.1


def test_joblib_and_dask_solve_the_changed_problem(changed: Problem, solved: Solution) -> None:
    """A point of a study, here, on joblib's processes and on a cluster; and whole calls there."""
    distributed = pytest.importorskip("distributed")
    from pkmsea.study.cluster import ClusterPool

    jobs = [PointJob(key=("all", changed.name, point, 0), problem=changed) for point in range(2)]
    local = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with local as cluster, distributed.Client(cluster) as client:
        whole = client.submit(partial(solve, workers=1), changed).result()  # `workers` is Dask's own word there
        assert whole.energy == pytest.approx(solved.energy, rel=SAME)
        for pool in (Pool(1), Pool(2), ClusterPool(client)):
            more = iter([jobs])
            answers = list(pool.unordered(run, lambda more=more: next(more, []), crashed))
            assert [x.found["energy"] for x in answers] == pytest.approx([solved.energy] * 2, rel=SAME), answers


def test_workers_solve_the_transcription_that_they_get(slider: Problem) -> None:
    """Not the one that the problem's options name."""
    once = replace(slider, options=slider.options.model_copy(update={"meshes": 1}))
    coarse = FlatTranscription(once, Spline(kind="spline", knots=32), None)
    one, two = ([start.claimed for start in multistart(coarse, workers)[0]] for workers in (1, 2))
    assert one == pytest.approx(two, rel=SAME)
    assert solve(coarse, workers=1).meshes[0].size == 32


def test_a_result_file_keeps_the_changed_problem(solved: Solution, tmp_path: Path) -> None:
    again = load(solved.save(tmp_path / "result.nc"))
    assert again.verified and again.energy == pytest.approx(solved.energy, rel=SAME)
    ours, theirs = ({**vars(s.problem)} for s in (solved, again))
    for key in ("name", "title", "drives", "cycle", "limits", "payload", "options"):
        assert ours[key] == theirs[key], key


@pytest.mark.parametrize("mechanism", ["pkm_2rrr", "examples/gallery/four_bar_press", "examples/gallery/ur5"])
def test_a_task_is_one_way_to_write_it(mechanism: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """build_problem(task_of(problem)) is the problem again, wherever Python runs by then."""
    root = Path(__file__).parents[1]
    if "/" in mechanism:
        problem = build_problem(root / mechanism / "task.yaml", load_first(root / mechanism / "task.yaml"))
    else:
        problem = build_problem(task(mechanism, RIGID))
    monkeypatch.chdir("/")
    again = build_problem(Task.model_validate_json(task_of(problem).model_dump_json()))
    assert replace(again, mechanism=problem.mechanism) == problem
    assert again.mechanism.folder.resolve() == problem.mechanism.folder.resolve()


def load_first(path: Path) -> str:
    return pkmsea.load_task(path).setups[0].name


def test_solve_takes_every_step_of_the_way(tmp_path: Path) -> None:
    said = task("linear_axis_1", SLIDER_RIGID, options=QUICK | {"starts": 1})
    file = tmp_path / "task.yaml"
    file.write_text(said.model_dump_json(exclude_none=True))
    problem = pkmsea.build_problem(file)
    ways = (file, str(file), said, problem, pkmsea.transcribe(problem))
    energies = [pkmsea.solve(way, workers=1).energy for way in ways]
    assert energies == pytest.approx([energies[0]] * len(ways), rel=SAME)
    with pytest.raises(InputError, match="Only a task has setups"):
        pkmsea.solve(problem, "setup")
    with pytest.raises(InputError, match="Give the path of a task file, a Task, a Problem or a Transcription"):
        pkmsea.solve(problem.cycle)  # type: ignore[arg-type]


def test_errors_of_a_solve_name_the_task_file(tmp_path: Path) -> None:
    file = tmp_path / "task.yaml"
    options = {"transcription": "paper", "trajectory": {"kind": "chain"}}
    said = task("pkm_2rrr", ELASTIC | {"damping": 1e-3}, options=options)
    file.write_text(said.model_dump_json(exclude_none=True))
    with pytest.raises(InputError, match=r"task\.yaml, damping: "):
        solve(file)


def test_public_objects_have_short_reprs(solved: Solution, tmp_path: Path) -> None:
    """One line each; functions and classes have Python's own."""
    from pkmsea.verification import verify

    problem = build_problem(task("pkm_3rrr", ELASTIC | {"friction": 1e-3, "gear_ratio": 20.0, "speed": 300.0}))
    study_file = tmp_path / "study.yaml"
    (tmp_path / "task.yaml").write_text(task_of(problem).model_dump_json(exclude_none=True))
    study_file.write_text("{name: s, task: task.yaml, vary: {cycle.period: {values: [1.0, 2.0, 3.0]}}}")
    study = pkmsea.load_study(study_file)
    faulty = replace(solved, claimed=2 * solved.claimed)
    rows: Any = [None] * 3
    said = task_of(problem)
    instances = {
        "Actuation": problem.actuation, "Audit": faulty.audit(), "Cycle": problem.cycle,
            "Description": problem.mechanism.description, "Drive": problem.drives[0],
        "Limits": Limits(position={f"joint {i}": (0.0, 1.0) for i in range(20)}), "Mechanism": problem.mechanism,
        "OperatingPoint": problem.cycle.points[0], "Optimality": solved.optimality(), "Optimum": solved.optima[0],
        "Options": problem.options, "PkmseaError": InputError("Wrong. " * 50, "Mend it."), "Problem": problem,
        "Setup": said.setups[0], "Solution": faulty, "Study": study,
        "StudyResult": pkmsea.StudyResult(study, rows, tmp_path, True), "Task": said,
        "Transcription": transcribe(problem), "Verification": verify(faulty),
    }  # fmt: skip
    classes = {name for name in pkmsea.__all__ if isinstance(getattr(pkmsea, name), type)}
    assert classes == instances.keys()
    for name, instance in instances.items():
        assert isinstance(instance, getattr(pkmsea, name)), name
        assert len(repr(instance)) < SHORT and "\n" not in repr(instance), repr(instance)
    assert repr(problem) == "<Problem 'setup': pkm_3rrr, drives: 3 sea, 2 points in 1 s, 18 bounds>"


def test_a_setup_in_another_assembly_mode(tmp_path: Path) -> None:
    """Its own seed goes before the mechanism's, is stored with the result, and is blamed where it is wrong."""
    seed = {"A": -0.6155, "elbow_A": -1.9106, "B": 1.4789, "elbow_B": -1.9106}
    setups = [{"name": "other elbow", "mechanism": "pkm_2rrr", "seed": seed, "drives": RIGID}]
    said = task("pkm_2rrr", RIGID, options=QUICK, setups=setups)
    problem, shipped = build_problem(said), build_problem(task("pkm_2rrr", RIGID))
    assert problem.mechanism.seed[3] == pytest.approx(-shipped.mechanism.seed[3], abs=1e-4)
    assert build_problem(task_of(problem)).mechanism.description == problem.mechanism.description
    solution = solve(problem, workers=1)
    solution.save(tmp_path / "a.nc")
    again = load(tmp_path / "a.nc")
    assert again.energy == pytest.approx(solution.energy, rel=1e-12) and changed_on_disk(tmp_path / "a.nc") == ""
    with pytest.raises(InputError) as caught:
        build_problem(task("pkm_2rrr", RIGID, setups=[setups[0] | {"seed": {"nobody": 1.0}}]))
    assert (caught.value.file, caught.value.key) == (None, "setups.0.seed")
