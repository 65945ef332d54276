"""Scans that only compute: errors that are known functions of the settings."""

RESULT = {"cause": None, "picture": None, "touched": True, "refused": False}
DRAG_MM, BREATH_MM, FLOOR_MM = 1.2, 0.9, 0.5
"""Parts of the loop's error, which add in the mean square."""
STIFF_N, BREATH_N = 0.1, 0.4
"""Parts of the force's error per unit of what is drawn, which add."""


def additive(run, folder):
    """Loop: floor, breath and drag, in the mean square. Force: stiffness and breath."""
    settings = run.settings
    breath = settings["scene.breathing.amplitude"] / 0.005
    drag = DRAG_MM if settings["scene.phantom.gel_friction"] > 0 else 0.0
    square = FLOOR_MM**2 + (BREATH_MM * breath) ** 2 + drag**2
    force = 0.3 + STIFF_N * settings["scene.phantom.young"] / 20e3 + BREATH_N * breath
    return RESULT | {
        "error": None,
        "executed_truth_rms_mm": square**0.5,
        "force_rmse_n": force,
    }


def fragile(run, folder):
    """Fatty breasts are refused; with much breath the contact is lost half-way."""
    found = additive(run, folder)
    if run.settings["scene.phantom.breast"] == "fatty":
        told = {"error": "PlanningError: too low", "cause": "PlanningError: too low"}
        return {**RESULT, **told, "refused": True, "touched": False}
    if run.settings["scene.breathing.amplitude"] > 0.0045:
        return found | {"error": "SafetyError: lost", "cause": "SafetyError: lost"}
    return found


def noting(run, folder):
    """As `additive`; leaves a line a run."""
    with (folder.parent / "log.txt").open("a") as log:
        log.write(f"{run.number}\n")
    return additive(run, folder)


def failing(run, folder):
    """Nothing ever ends well."""
    return RESULT | {"error": "RobotError: gone", "cause": "RobotError: gone"}
