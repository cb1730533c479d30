"""Lists the elements that the papers describe, their place in this program, and the reason for
each missing element.
"""

from __future__ import annotations

from .page import Section, Table

# The words appear in the page and in its counts.
YES, PARTLY, NO = "yes", "partly", "no"
# Short names of the three papers: decision system, lag of map control, point fertilisation.
DECISION, LAG, POINT = "decision", "lag", "point"

# Each row has paper, element, presence, place (paths of the source, commands of `topdress`), and a
# remark.
PAPER_ELEMENTS: tuple[tuple[str, str, str, str, str], ...] = (
    (
        DECISION,
        "eq 1: Christiansen's uniformity, CV",
        YES,
        "control/agronomy/sampling_frequency.py",
        "",
    ),
    (
        DECISION,
        "section 1.2: readings compared at 2 to 0.125 Hz, the frequency chosen",
        YES,
        "control/agronomy/sampling_frequency.py; topdress trial",
        "of the paper's table, and of a log's own readings",
    ),
    (DECISION, "eq 2: urea for a yield", YES, "control/agronomy/nitrogen_rate.py", "never below 0"),
    (
        DECISION,
        "eq 3, 4: yield without topdressing, INSEY",
        YES,
        "control/agronomy/yield_potential.py",
        "constants and day rule bound to one another",
    ),
    (
        DECISION,
        "eq 5: response index, Y_max; 6.73 t/ha without a strip",
        YES,
        "control/agronomy/nitrogen_rate.py",
        "",
    ),
    (
        DECISION,
        "section 2.1 (5): 11 grades, nothing outside 0.25 to 0.75",
        YES,
        "control/agronomy/nitrogen_rate.py",
        "width 0.05; the print says 0.5",
    ),
    (
        DECISION,
        "six GreenSeeker heads, fused",
        YES,
        "drivers/devices/canopy_heads.py; control/agronomy/head_fusion.py",
        "two other makes as well",
    ),
    (
        DECISION,
        "GPS, wheel sensor, shaft speed sensor, displacement sensor",
        YES,
        "drivers/cab.py",
        "",
    ),
    (
        DECISION,
        "shaft by a DC motor, opening by a stepper, both at once",
        YES,
        "drivers/board/slave.py; control/metering/pair_planner.py",
        "",
    ),
    (
        DECISION,
        "opening first or speed first, by the operator",
        YES,
        "control/metering/strategies.py",
        "",
    ),
    (DECISION, "display: place, speed, motor, opening, amount", YES, "console/app/pages/run", ""),
    (DECISION, "SD card", YES, "drivers/files/run_log.py", "a log on the computer's disk"),
    (
        DECISION,
        "touch screen WQT_T8060_104 in the cab",
        PARTLY,
        "console/serve; console/app/tablet_app.py",
        "any terminal or browser; not that device",
    ),
    (
        DECISION,
        "trial: plots, weighed kilograms, NDVI before and after, yield samples (tables 2, "
        "3, figure 7)",
        YES,
        "topdress trial; control/papers/field_trial.py",
        "of own plots; the paper's own stand in its chapter",
    ),
    (LAG, "T_lag = response + drop time; eq 6", YES, "control/machine/fall.py", ""),
    (
        LAG,
        "eq 1: lag distance; command where the boundary is L away",
        YES,
        "control/targets/lag_correction.py",
        "by the machine model; eq 6 alone in the paper's figures",
    ),
    (
        LAG,
        "eq 2: cell by half cells",
        YES,
        "control/papers/map_geometry.py",
        "the program looks up zones instead",
    ),
    (
        LAG,
        "eq 3: distance on the sphere",
        PARTLY,
        "control/geodesy.py",
        "as printed only to show what it costs",
    ),
    (
        LAG,
        "eq 4, 5: where the line meets the edge",
        PARTLY,
        "control/field/boundary.py; control/papers/map_geometry.py",
        "by vectors; as printed they halve the way",
    ),
    (
        LAG,
        "detector: plate, encoder, Arduino Uno, times to the computer",
        YES,
        "drivers/board/lag_rig.py; topdress calibrate lag",
        "on a Pico or in the console",
    ),
    (
        LAG,
        "prescription map: grid with a rate a cell",
        YES,
        "drivers/files/prescriptions/map_reader.py",
        "",
    ),
    (
        LAG,
        "tables 1 to 4: lag over shaft speed; tables 5, 6: the correction",
        YES,
        "control/papers/correction_experiment.py",
        "",
    ),
    (
        LAG,
        "EDEM simulation of granules",
        NO,
        "",
        "named in the paper without a figure, a model or a result; nothing "
        "to hold anything against. Drop time is measured, not computed from particles",
    ),
    (
        POINT,
        "eq 1 to 5: lag distance of a dose",
        YES,
        "control/targets/point_mode.py",
        "with the factor 6 in eq 3",
    ),
    (
        POINT,
        "threshold T, from speed, distance, doses done",
        YES,
        "control/targets/point_mode.py",
        "learned from measured dose errors; the paper used a constant",
    ),
    (
        POINT,
        "measured dose errors (section 2.4)",
        YES,
        "console/app/pages/run/keys.py; drivers/files/prescriptions/job_targets.py",
        "measured behind the machine, by key and by file; no sensor measures them",
    ),
    (
        POINT,
        "host in Python with a serial line; slave a MicroPython board",
        YES,
        "drivers/board/slave.py",
        "",
    ),
    (
        POINT,
        "STM32F407 TPYBoard, TB6600 driver, pins",
        PARTLY,
        "drivers/board/rp2_slave.py",
        "for the Pico; the frames are the same for any board",
    ),
    (POINT, "table 1: microstep modes", YES, "control/papers/point_paper.py", ""),
    (
        POINT,
        "camera and program that see the plant",
        NO,
        "control/simulation/simulated_camera.py",
        "no driver: the paper "
        "describes neither, but for 1.5 s. Simulated; a plant list stands in at work",
    ),
    (
        POINT,
        "doses placed on artificial maize",
        PARTLY,
        "control/simulation/point_run.py",
        "simulated; not driven",
    ),
)


def make_elements_section() -> Section:
    """Returns the section with the table of all elements."""
    # The counts are computed, so that text and table cannot differ.
    count = {here: sum(row[2] == here for row in PAPER_ELEMENTS) for here in (YES, PARTLY, NO)}
    return Section(
        "Every element of the papers",
        (
            f"{len(PAPER_ELEMENTS)} elements: {count[YES]} are here, {count[PARTLY]} in part, "
            f"{count[NO]} not. Never will be "
            "the simulation of granules by EDEM, of which the paper prints nothing; the "
            "camera it does not describe.",
        ),
        (
            Table(
                "Elements, and where they are",
                ("paper", "element", "here", "where", "remark"),
                PAPER_ELEMENTS,
                (0,) * 5,
            ),
        ),
    )
