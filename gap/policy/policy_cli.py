"""`walkerkit policy`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def policy(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a diagnosis.")],
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="The policy's model as given: MJCF file or package.module:callable.",
        ),
    ],
    policy: Annotated[
        str, typer.Option(help=".onnx, .pt (TorchScript), or package.module:callable.")
    ],
    environment: Annotated[
        str,
        typer.Option(
            metavar="MODULE:CALLABLE",
            help="A function of the robot that returns a dm_control environment with it.",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; by default DIR/policy.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Only this one of the named effects. May be given several times."),
    ] = None,
    episodes: Annotated[int, typer.Option(help="For each robot.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Of the first episode.")] = 0,
    seconds: Annotated[
        float | None, typer.Option(help="Longest episode; by default until it ends.")
    ] = None,
    measure: Annotated[
        str, typer.Option(metavar="return|falls|tracking", help="What the policy is judged by.")
    ] = "return",
    margin: Annotated[
        float, typer.Option(help="Share of it that may be lost before the policy counts as broken.")
    ] = 0.1,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace what another run has left in the folder.")
    ] = False,
    allow_outside: Annotated[
        bool,
        typer.Option("--allow-outside", help="Let the model read files outside of its folder."),
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print policy.json instead of tables.")
    ] = False,
) -> None:
    """Say which of the effects that a diagnosis has named breaks a policy."""
    from rich.console import Console

    from walkerkit.gap.policy.policy_console import render
    from walkerkit.gap.policy.policy_gap import FILE, KIND, PAGE, policy_gap
    from walkerkit.gap.report.output import check_folder, check_free

    target = folder / "policy" if out is None else out
    check_folder(target)
    check_free(target, (FILE, PAGE), kind=KIND, overwrite=overwrite)
    found = policy_gap(
        environment,
        policy,
        folder,
        model=model,
        effects=effect or (),
        episodes=episodes,
        seed=seed,
        seconds=seconds,
        measure=measure,  # type: ignore[arg-type]
        margin=margin,
        allow_outside=allow_outside,
        progress=lambda stage, done: typer.echo(f"{done:4.0%} {stage}", err=True),
    )
    found.save(target, overwrite=overwrite)
    if json:
        typer.echo(found.to_json(), nl=False)
        return
    console = Console()
    console.print(render(found))
    console.print(f"Look at {target / PAGE}", markup=False, soft_wrap=True)
