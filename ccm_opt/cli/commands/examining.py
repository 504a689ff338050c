"""Commands that look closer: at an arm, at what it does with a plan, and at what the plan survives."""

from typing import Annotated

import typer

from ccm_opt.cli.choices import ControllerChoice
from ccm_opt.cli.command_group import command
from ccm_opt.cli.commands.options import Changes, Folders, ProblemFiles

app = typer.Typer()
"""The commands of this file."""


@command(
    app,
    "describe",
    ("ccm-opt describe problems/swan-neck.toml",),
)
def describe_command(
    files: ProblemFiles,
    *,
    changes: Changes = None,
) -> int:
    """Print the arm of problems: link parameters, drives, masses."""
    from ccm_opt.cli.describing import describe_files  # noqa: PLC0415 - loads numpy

    return describe_files(files, changes or ())


@command(
    app,
    "simulate",
    ("ccm-opt simulate runs/swan-neck --payload 0.2 --no-pictures",),
)
def simulate_command(
    folders: Folders,
    *,
    controller: Annotated[ControllerChoice | None, typer.Option(help="Controller.")] = None,
    step: Annotated[float | None, typer.Option(min=1e-6, help="Integration step, in s.")] = None,
    bandwidth: Annotated[
        float | None, typer.Option(min=1e-3, help="Bandwidth of computed torque and of the feed axis, in 1/s.")
    ] = None,
    payload: Annotated[float | None, typer.Option(help="Mass at the tip, unknown to the controller, in kg.")] = None,
    mass_error: Annotated[
        float | None, typer.Option(help="Fraction by which the links are heavier than the controller believes.")
    ] = None,
    friction: Annotated[
        float | None, typer.Option(help="Viscous friction, unknown to the controller, in N m s/rad.")
    ] = None,
    angle_noise_deg: Annotated[float | None, typer.Option(help="Noise of the measured angles, in degrees.")] = None,
    velocity_noise: Annotated[float | None, typer.Option(help="Noise of the measured velocities, in rad/s.")] = None,
    start_delay: Annotated[
        float | None, typer.Option(help="How long the brakes hold the arm before it starts, in s.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the noise.")] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> int:
    """Simulate written plans again, with other settings and disturbances."""
    from math import radians  # noqa: PLC0415

    from ccm_opt.cli.simulating import Overrides, simulate_folders  # noqa: PLC0415 - loads numpy

    options = {"controller": controller, "step": step, "bandwidth": bandwidth}
    disturbances = {
        "payload": payload,
        "mass_error": mass_error,
        "friction": friction,
        "angle_noise": None if angle_noise_deg is None else radians(angle_noise_deg),
        "velocity_noise": velocity_noise,
        "start_delay": start_delay,
        "seed": seed,
    }
    return simulate_folders(folders, Overrides(options, disturbances), pictures=not no_pictures)


@command(
    app,
    "tolerance",
    ("ccm-opt tolerance runs/swan-neck",),
)
def tolerance_command(
    folders: Folders,
    *,
    no_simulation: Annotated[
        bool, typer.Option("--no-simulation", help="Leave out payload and friction, which are found by simulations.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> int:
    """Say which errors of joints, links, base, walls and loads written plans survive."""
    from ccm_opt.cli.tolerating import tolerance_of_folders  # noqa: PLC0415 - loads numpy

    return tolerance_of_folders(folders, simulated=not no_simulation, pictures=not no_pictures)
