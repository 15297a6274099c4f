"""The compensator against the acceptance test and the thesis' degraded modes: figures 2-20 to 2-22, tables 2-7 to 2-9."""

import math

import numpy as np
import pytest
from sksundae.cvode import CVODE

from benchmarks.right_hand_side import rates
from twin.laws.compressibility import relative_density
from twin.laws.friction import friction_damping_ahead
from twin.parts.piston import chamber_volume
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.layout import (
    ALPHA,
    N_COLUMNS,
    N_SHARED,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    THETA,
    V_RATE,
    V_STROKE,
    X_STROKE,
)
from twin.simulation.run import Run, simulate
from twin.simulation.scenario import Scenario, Schedule
from twin.simulation.scene import Scene, scene_of
from twin.units import M3_PER_S_PER_LPM
from twin.validation.compensator import compensator, erosion, jamming
from twin.validation.effects import TABLE_2_7, Effect, with_fields
from twin.validation.evidence import Evidence
from twin.validation.load_step import CONDITION, full_flow_opening, load_step

PUMP = pump_type("h225").pump
FREE = with_fields(PUMP, {"servo.contact": 1.0})
STAND = circuit_parameters("acceptance_stand")
N = int(PUMP.piston.n)
PERIOD_S = 60.0 / CONDITION.speed_rpm
SHUTTING = Schedule((0.0, 0.005), (25.0, 0.0))


def failed(evidence: Evidence) -> list[str]:
    missed = [r for r in evidence.rows if r.within is False and not r.known_miss]
    return [f"{r.quantity}: {r.value:g} against {r.reference:g}" for r in missed]


def value(evidence: Evidence, words: str) -> float:
    rows = [r for r in evidence.rows if words in r.quantity]
    assert rows, words
    return rows[0].value


@pytest.fixture(scope="module")
def accepted() -> Evidence:
    return compensator()


@pytest.fixture(scope="module")
def eroded() -> Evidence:
    return erosion()


@pytest.fixture(scope="module")
def jammed() -> Evidence:
    return jamming()


class TestAcceptance:
    def test_every_specification_is_met(self, accepted: Evidence) -> None:
        assert failed(accepted) == []
        assert sum(r.within is True for r in accepted.rows) >= 9

    def test_the_fitted_peak_says_so(self, accepted: Evidence) -> None:
        peaks = [r for r in accepted.rows if "peak pressure" in r.quantity and r.limit]
        assert peaks
        assert all(r.fitted for r in peaks)
        assert all(not r.fitted for r in accepted.rows if "settle" in r.quantity or "response" in r.quantity)

    def test_pressure_rises_when_the_load_shuts_and_flow_comes_back(self, accepted: Evidence) -> None:
        pressure, flow, tilt = (plot.curves[0] for plot in accepted.plots)
        assert pressure.x[np.argmax(pressure.y)] == pytest.approx(0.267, abs=0.005)
        assert np.abs(flow.y[(flow.x > 0.26) & (flow.x < 1.24)]).max() < 0.01
        assert flow.y[-1] == pytest.approx(flow.y[0], rel=0.01)
        assert tilt.y[(tilt.x > 1.0) & (tilt.x < 1.24)].max() < 2.0


class TestErosion:
    def test_gain_falls_and_answer_worsens(self, eroded: Evidence) -> None:
        assert failed(eroded) == []

    def test_published_laws_lose_a_sixth_of_their_gain_at_ten_times_the_radius(self, eroded: Evidence) -> None:
        for law in ("Mare's edges", "Attar's edges"):
            row = next(r for r in eroded.rows if r.quantity == f"pressure gain at 10 times the radius, {law}")
            assert 0.7 < row.value / row.reference < 0.9

    def test_zero_flow_pressure_shifts_up_a_little(self, eroded: Evidence) -> None:
        shift = value(eroded, "shift of the zero-flow pressure at 10 times the radius, Mare")
        assert 0.02 < shift < 1.0


class TestJamming:
    def test_events_come_in_the_thesis_order_and_pressure_recovers(self, jammed: Evidence) -> None:
        assert failed(jammed) == []
        assert sum(r.quantity.endswith("events in order") for r in jammed.rows) == 2

    def test_a_jam_in_balance_does_not_overshoot(self, jammed: Evidence) -> None:
        assert value(jammed, "jammed when settled") < 180.0


class TestBreakingFree:
    """Friction at the speed that a step ends with (equation 2-25): one step frees a body that hardly moved."""

    @pytest.mark.parametrize("drive", [510.0, 600.0, -600.0])
    def test_pushed_harder_than_friction_it_moves_by_the_rest(self, drive: float) -> None:
        inertia = 300.0
        damping = friction_damping_ahead(500.0, 500.0, 2.0e-4, drive, inertia)
        assert drive / (inertia + damping) == pytest.approx(
            math.copysign(abs(drive) - 500.0, drive) / inertia, rel=1e-3
        )

    def test_pushed_less_it_creeps(self) -> None:
        damping = friction_damping_ahead(500.0, 500.0, 2.0e-4, 400.0, 300.0)
        assert 0.0 < 400.0 / (300.0 + damping) < 2.0e-4

    def test_default_step_frees_the_spool_when_short_steps_do(self) -> None:
        """Within 0.2 ms: the friction of the step's start would take 1.5 ms longer."""
        opening = full_flow_opening(PUMP, STAND)
        load = Schedule((0.25, 0.255), (opening, 0.0))
        changes = {"load_conductance_lpm_per_sqrt_bar": load, "spool_jamming_force_n": Schedule.step(0.3, 0.0, 500.0)}
        scenario = Scenario(0.34, CONDITION, changes=changes)
        freed = []
        for step in (60.0e-6, 5.0e-6):
            recording = simulate(PUMP, STAND, scenario, sample_rate_hz=10_000.0, step_s=step).recording
            time, x = recording.time_s, recording["spool_position_mm"]
            freed.append(float(time[(time > 0.3) & (x > x[np.searchsorted(time, 0.3)] + 0.05)][0]))
        assert freed[0] == pytest.approx(freed[1], abs=2.0e-4)


class TestTable27:
    def test_lists_24_effects_once(self) -> None:
        assert len(TABLE_2_7) == 24
        assert len({(e.body, e.name) for e in TABLE_2_7}) == 24

    @pytest.mark.parametrize("effect", TABLE_2_7, ids=lambda e: f"{e.body}: {e.name}")
    def test_every_effect_can_be_switched_on(self, effect: Effect) -> None:
        scenario = Scenario(3.0 * PERIOD_S, CONDITION, changes={"discharge_flow_lpm": SHUTTING})
        off, on = (simulate(with_fields(PUMP, fields), STAND, scenario) for fields in (effect.off, effect.on))
        assert off.status.ok
        assert on.status.ok
        apart = np.abs(off.recording["discharge_pressure_bar"] - on.recording["discharge_pressure_bar"])
        assert apart.max() > 1.0e-3


class TestSporadicContact:
    """Servo pistons as bodies of their own (equation 2-14) beside pistons that the plate carries."""

    def test_load_step_stays_close_to_carried_pistons(self) -> None:
        carried, free = (load_step(pump, STAND) for pump in (PUMP, FREE))
        apart = np.abs(carried["discharge_pressure_bar"] - free["discharge_pressure_bar"])
        assert 0.01 < apart.max() < 3.0

    def test_stroking_piston_leaves_the_plate_and_comes_back(self) -> None:
        """At full tilt nothing but its flow holds it: the plate throws it off as the load opens."""
        opening = full_flow_opening(FREE, STAND)
        load = Schedule((0.05, 0.055, 0.15, 0.155), (opening, 0.0, 0.0, opening))
        scenario = Scenario(0.25, CONDITION, changes={"load_conductance_lpm_per_sqrt_bar": load})
        run = simulate(FREE, STAND, scenario, keep_states=True)
        depth = run.states[:, X_STROKE] + FREE.servo.L_stroke * np.tan(run.states[:, ALPHA])
        assert run.status.ok
        assert depth.min() < -1.0e-6
        assert depth[-1] > 0.0

    def test_mass_is_conserved(self) -> None:
        run = self.shutting(FREE, 0.04, extrapolate=False)
        rec, dt = run.recording, float(run.recording.time_s[1] - run.recording.time_s[0])
        scene = self.scene(0.0)
        flow = rec["suction_flow_lpm"] - rec["return_flow_lpm"] - rec["case_flow_lpm"]
        entered = float(flow[1:].sum()) * dt * M3_PER_S_PER_LPM
        throughput = float(rec["suction_flow_lpm"].sum()) * dt * M3_PER_S_PER_LPM
        gained = self.stored(run.states[-1], scene) - self.stored(run.states[0], scene)
        assert gained == pytest.approx(entered, abs=1.0e-6 * throughput)

    def test_implicit_step_follows_the_right_hand_side(self) -> None:
        """CVODE on ``rates`` from the middle of the load step, 1.5 ms on."""
        begun = self.shutting(FREE, 0.009).states[-1]
        duration, scene = 1.5e-3, self.scene(0.0)
        end = simulate(
            FREE, STAND, Scenario(duration, CONDITION), sample_rate_hz=1.0 / duration, step_s=1.0e-6,
            initial_state=begun, keep_states=True,
        )  # fmt: skip
        assert end.status.ok
        scale = np.full(len(begun), 1.0e5)
        scale[4:N_SHARED] = (1e-4, 1e-2, 1e-2, 1.0, 1.0, 100.0, 1e-3, 0.1, 1e-3, 0.1)
        clearances, table = np.ones((N, 2)), np.zeros((N, N_COLUMNS))

        def f(t: float, y: np.ndarray, dy: np.ndarray) -> None:
            rates(FREE, STAND, scene, y * scale, N, clearances, table, dy)
            dy /= scale

        solver = CVODE(f, method="BDF", rtol=1e-8, atol=1e-8, max_num_steps=1_000_000)
        solution = solver.solve(np.array([0.0, duration]), begun / scale)
        assert solution.success
        reference, reached = solution.y[-1] * scale, end.states[-1]
        for j, tolerance in ((P_D, 0.05e5), (P_C, 0.01e5), (P_CTRL, 0.5e5), (ALPHA, 2e-4), (X_STROKE, 5e-6)):
            assert reached[j] == pytest.approx(reference[j], abs=tolerance), j
        for j in (V_STROKE, V_RATE):
            assert reached[j] == pytest.approx(reference[j], rel=0.02, abs=0.005), j

    @staticmethod
    def shutting(pump, duration_s: float, *, extrapolate: bool = True) -> Run:  # type: ignore[no-untyped-def]
        scenario = Scenario(duration_s, CONDITION, changes={"discharge_flow_lpm": SHUTTING})
        return simulate(pump, STAND, scenario, keep_states=True, extrapolate=extrapolate)

    @staticmethod
    def scene(flow_lpm: float) -> Scene:
        scenario = Scenario(1.0, CONDITION._replace(discharge_flow_lpm=flow_lpm))
        return scene_of(FREE, STAND, scenario.table(N)[1][0])

    @staticmethod
    def stored(y: np.ndarray, scene: Scene) -> float:
        """Fluid in all volumes, counted at ambient density [m3]."""
        t, volumes = math.tan(y[ALPHA]), FREE.volumes
        fluid = 0.0
        for k in range(N):
            V = chamber_volume(FREE.piston, scene.t_max, t, math.cos(y[THETA] + 2 * math.pi * k / N))
            fluid += relative_density(scene.medium, y[N_SHARED + k]) * V
        fixed = {P_D: volumes.discharge, P_C: volumes.case, P_I: volumes.return_line, P_CTRL: volumes.control}
        return fluid + sum(relative_density(scene.medium, y[j]) * V for j, V in fixed.items())
