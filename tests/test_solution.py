"""Solved cycles: known optima, limits of the model, audits that catch what is wrong, files that keep it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import ELASTIC, PARALLEL, RIGID, SLIDER_ELASTIC, SLIDER_RIGID, task

from pkmsea.errors import Infeasible, InputError
from pkmsea.files import write_whole
from pkmsea.motion import Motion
from pkmsea.solution import Solution, solve
from pkmsea.solution.audit import BALANCE, CLOSURE
from pkmsea.solution.store import load

FOURIER = {"trajectory": {"kind": "fourier", "order": 10}, "starts": 3}


@pytest.fixture(scope="module")
def elastic() -> Solution:
    return solve(task("pkm_2rrr", ELASTIC | {"friction": 4.79e-3}), workers=1)


def test_eigenmotion_without_friction_and_rest() -> None:
    """Then c = w^2 m_M m_C / (m_M + m_C) and E = 0 (design: paper, end of section 3)."""
    points = [{"at": [0.7], "rest": 0, "window": 1e-3}, {"at": [1.1], "rest": 0, "window": 1e-3}]
    drives = SLIDER_ELASTIC | {"friction": 0}
    solution = solve(task("linear_axis_1", drives, cycle={"period": 2.0, "points": points}, options=FOURIER), workers=1)
    expected = np.pi**2 * 2 * 5 / (2 + 5)
    assert solution.stiffness[0] == pytest.approx(expected, rel=0.01)
    assert solution.energy < 1e-3


@pytest.mark.parametrize(
    ("mechanism", "rigid", "elastic"),
    [("linear_axis_1", SLIDER_RIGID, SLIDER_ELASTIC), ("pkm_2rrr", RIGID, ELASTIC)],
)
def test_a_very_stiff_spring_is_rigid(mechanism: str, rigid: dict, elastic: dict) -> None:
    stiff = elastic | {"stiffness": 1e6}
    energies = [solve(task(mechanism, drives), workers=1).energy for drives in (rigid, stiff)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-3)


def test_stagnation_ends_a_solve_early(elastic: Solution) -> None:
    """From a motion with springs that are too stiff: fewer iterations, and an energy at most a little higher."""
    near = replace(elastic, motion=replace(elastic.motion, stiffness=elastic.motion.stiffness * 1.3))
    options = [elastic.problem.options.model_copy(update={"stagnation": change}) for change in (0.0, 1e-3)]
    sharp, early = (solve(replace(elastic.problem, options=o), near=near) for o in options)
    iterations = [sum(mesh.iterations for mesh in solution.meshes) for solution in (sharp, early)]
    assert iterations[1] < iterations[0]
    assert early.verified and sharp.energy <= early.energy * (1 + 1e-6) <= sharp.energy * 1.01


def test_audit_of_a_solved_cycle(elastic: Solution) -> None:
    audit = elastic.audit()
    assert audit.verified, audit.faults
    assert audit.balance < BALANCE
    assert audit.closure < CLOSURE
    assert audit.window <= 0
    assert elastic.energy == pytest.approx(elastic.claimed, rel=5e-3)
    s = elastic.series
    np.testing.assert_allclose(s.q_M - s.q[:, [0, 2]], s.u / elastic.stiffness, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("wrong", ["stiffness", "claimed", "position"])
def test_audit_catches_a_wrong_result(elastic: Solution, wrong: str) -> None:
    motion, coefficients = elastic.motion, elastic.motion.coefficients.copy()
    if wrong == "stiffness":
        changed = replace(elastic, motion=Motion(motion.basis, coefficients, motion.stiffness * [2.0, 1]))
    elif wrong == "claimed":
        changed = replace(elastic, claimed=elastic.claimed * 0.98)
    else:
        coefficients[0, 0] += 5e-3
        changed = replace(elastic, motion=Motion(motion.basis, coefficients, motion.stiffness.copy()))
    assert not changed.verified
    assert changed.status.startswith("not verified: ")


def test_rest_windows_hold_at_every_instant() -> None:
    """Different rests and windows per point and axis, three points."""
    points = [
        {"at": [-0.05, -0.05], "rest": [0.1, 0.05], "window": [1e-3, 3e-3]},
        {"at": [0.05, 0.0], "rest": 0.0, "window": 2e-3, "time": 0.4},
        {"at": [0.0, 0.06], "rest": 0.12, "window": 1e-3, "time": 0.7},
    ]
    solution = solve(task("pkm_2rrr", RIGID, cycle={"period": 1.2, "points": points}), workers=1)
    assert solution.verified, solution.status
    for start, end, axis, at, deviation in [(0.64, 0.76, 1, 0.06, 1e-3), (-0.025, 0.025, 1, -0.05, 3e-3)]:
        r_E = solution.motion.flat_output(np.linspace(start, end, 2001))[:, axis]
        assert np.abs(r_E - at).max() <= deviation + 1e-9


def test_limits_are_kept_and_cost_energy() -> None:
    free = solve(task("pkm_2rrr", RIGID), workers=1)
    peak = np.abs(free.series.tau).max()
    fastest = np.abs(free.motion.flat_output(free.series.t, 1)).max()
    limits = {"end_effector": {"velocity": 0.97 * fastest}}
    bound = solve(task("pkm_2rrr", RIGID | {"torque": 0.97 * peak}, limits=limits), workers=1)
    assert bound.verified, bound.status
    assert np.abs(bound.series.tau).max() <= 0.97 * peak
    assert np.abs(bound.motion.flat_output(bound.series.t, 1)).max() <= 0.97 * fastest
    assert bound.energy >= free.energy * (1 - 1e-4)


def test_mixed_and_redundant_rigid_drives_solve() -> None:
    mixed = solve(task("pkm_3rrr", [RIGID, ELASTIC, ELASTIC]), workers=1)
    redundant = solve(task("pkm_3rrr", RIGID), workers=1)
    assert mixed.verified and redundant.verified
    assert len(mixed.stiffness) == 2 and len(redundant.stiffness) == 0


def test_a_period_too_short_for_the_torque_is_infeasible() -> None:
    cycle = {"period": 0.25, "points": [{"at": [-0.07, -0.07], "rest": 0.02, "window": 1e-3},
                                        {"at": [0.07, 0.07], "rest": 0.02, "window": 1e-3}]}  # fmt: skip
    options = {"starts": 2, "iterations": 100}
    with pytest.raises(Infeasible, match=r"period of 0\.25 s.*Lengthen the period"):
        solve(task("pkm_2rrr", RIGID | {"torque": 0.01}, cycle=cycle, options=options), workers=1)


def test_result_file_keeps_everything(elastic: Solution, tmp_path: Path) -> None:
    path = elastic.save(tmp_path / "ä result.nc")
    again = load(path)
    assert again.energy == pytest.approx(elastic.energy, rel=1e-12)
    np.testing.assert_array_equal(again.stiffness, elastic.stiffness)
    with xr.open_dataset(path, engine="h5netcdf") as data:
        assert data["tau"].attrs["units"].startswith("N m")
        assert list(data["drive"].values) == ["A", "B"]
        assert data.attrs["status"] == "verified"
        assert float(data["energy"][-1]) == pytest.approx(elastic.energy, rel=1e-3)


def test_a_damaged_result_file_is_named(elastic: Solution, tmp_path: Path) -> None:
    path = elastic.save(tmp_path / "result.nc")
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match=r"result\.nc: The result file cannot be read"):
        load(path)


def test_files_are_written_whole_or_not_at_all(tmp_path: Path) -> None:
    def interrupted(path: Path) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "result.nc", interrupted)
    assert list(tmp_path.iterdir()) == []


def test_workers_do_not_change_the_result() -> None:
    drives = task("linear_axis_1", SLIDER_ELASTIC, options=FOURIER)
    one, two = (solve(drives, workers=workers) for workers in (1, 2))
    assert one.energy == pytest.approx(two.energy, rel=1e-9)
    assert [start.outcome for start in one.starts] == [start.outcome for start in two.starts]


def test_payload_and_parallel_springs_solve() -> None:
    """The stage equations and the flat map see the same payload; springs that carry the arms save much."""
    payload = {"mass": 0.1, "pick": 1, "place": 2}
    rigid, parallel = (
        solve(task("pkm_2rrr", drives, payload=payload), workers=1) for drives in (RIGID, RIGID | PARALLEL)
    )
    assert rigid.verified and parallel.verified, (rigid.status, parallel.status)
    assert parallel.energy < 0.5 * rigid.energy
    assert np.all(np.isfinite(parallel.motion.parallel))


def test_damped_springs(elastic: Solution) -> None:
    """Little damping costs little; more costs more; the power balance, dampers included, closes."""
    energies = []
    for damping in (1e-6, 2e-3):
        drives = ELASTIC | {"friction": 4.79e-3, "damping": damping}
        solution = solve(task("pkm_2rrr", drives, options={"starts": 2}), workers=1)
        assert solution.verified, solution.status
        assert solution.audit().balance < BALANCE
        energies.append(solution.energy)
    assert energies[0] == pytest.approx(elastic.energy, rel=1e-3)
    assert energies[1] > elastic.energy


def test_the_papers_transcription_refuses_what_it_does_not_know() -> None:
    options = {"transcription": "paper", "trajectory": {"kind": "chain"}}
    with pytest.raises(InputError, match=r"damping: .*paper's transcription has no damping.*flat"):
        solve(task("pkm_2rrr", ELASTIC | {"damping": 1e-3}, options=options))
