"""A whole task in Python: what springs save a five-bar with heavy rotors, over the same robot with rigid drives.

Run it from anywhere: python examples/task_in_python.py
"""

from dataclasses import replace

import pkmsea

PICK, PLACE = (-0.07, -0.07), (0.07, 0.07)  # [m]
MOTOR = {"inertia": 4.6e-4, "copper_loss": 63.4, "torque": 0.3}  # [kg m^2], [W/(N m)^2], [N m]


def main() -> None:
    task = pkmsea.Task(
        name="five-bar",
        cycle=pkmsea.Cycle(
            period=1.0,
            points=[pkmsea.OperatingPoint(at=at, rest=0.1, window=1e-3) for at in (PICK, PLACE)],
        ),
        limits={"end_effector": pkmsea.Limits(velocity=2.0)},
        setups=[
            pkmsea.Setup(
                name="elastic",
                mechanism="pkm_2rrr",
                drives=pkmsea.Drive(kind="sea", stiffness={"bounds": (0.01, 1.0)}, **MOTOR),
            )
        ],
        options=pkmsea.Options(starts=4),
    )
    problem = pkmsea.build_problem(task)
    elastic = pkmsea.solve(pkmsea.transcribe(problem))
    rigid = pkmsea.solve(replace(problem, name="rigid", drives=[pkmsea.Drive(kind="rigid", **MOTOR)]))
    print(f"springs leave {elastic.energy / rigid.energy:.1%} of the energy ({elastic.status}, {rigid.status})")


if __name__ == "__main__":
    main()
