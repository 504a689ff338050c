"""The page of all commands and options, made from the parsers of ``ccm-opt``."""

import inspect
from dataclasses import dataclass
from enum import EnumType
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from typer.models import ArgumentInfo, CommandInfo, OptionInfo

from ccm_opt.cli.commands import app

HEAD = """\
# Commands and options

<!-- This page is made by `python docs/write_references.py` from the parsers of the commands. -->

`ccm-opt COMMAND --help` says the same in a terminal; `ccm-opt --install-completion` teaches your shell to complete it.

## All commands

### Which problem

Commands that read problem files take several, and `-` for standard input. `--set`, which may be repeated, changes a key
for one run:

```sh
ccm-opt solve problems/swan-neck.toml --set arm.radius=0.02 --set "goal.position=[0.4, 0.1]"
ccm-opt new own
ccm-opt solve own.toml --set "workspace.obstacles[pump].circle.radius=70" --set goal.heading_deg=90
```

An entry of a list is given by its index, from 0, or by its name. Values are written as in the file; what is no TOML
value is a string. The record of the plan holds the changed problem. `solve` has short forms for three keys of the table
`planner`: `--method`, `--time-limit` and `--seed`.

### What is printed

| option | standard output | standard error |
|---|---|---|
| none | tables | errors, warnings and progress |
| `--quiet` | nothing | errors and warnings |
| `--verbose` | tables, with every check of the verifier | also a line for every stage, and the package's log |
| `--json` | one JSON document | as without it |

Progress is one line on a terminal, and elsewhere plain lines from the third second on:

```text
room: motion, 12.3 of 60 s, candidate 4 (tip-led, way 2), closest so far 42.5 mm from the goal
```

From Python, `progress=` of `ccm_opt.solve` is called with the same data.

### For programs

The document of `--json` has the version `ccm_opt`, the name of the `command`, its `exit_code`, and `results`, one for
every file or folder in the given order:

| key | content |
|---|---|
| `item` | the file or folder |
| `exit_code` | of this one |
| `status` | that of [`solution.json`](output.md), or `"refused"`, `"bad input"`, `"cancelled"`, `"bug"` |
| `folder` | its output folder |
| `errors`, `warnings` | messages on standard error |
| `defects` | of bad input: `line`, `key` and `message` of each |
| `diagnosis` | [why there is no plan](no-plan.md), as in `solution.json` |

The rest is the command's record: that of `solution.json` without the problem for `solve`, `checks`, `room` and
`unchecked_constraints` for `check`, and so on. Numbers that are not finite are `null`.

### Constraints of a written plan

An output folder holds the names of your constraints only. `ccm-opt check` checks those that you give it, and names the
others:

```sh
ccm-opt check runs/swan-neck --constraint terms.py:camera_sees_valve
```

A constraint that depends on `q.path_parameter` cannot be checked, as the folder does not hold it.

### Where it runs

- **Ctrl-C** ends a command with exit code 130 and one line.
- **Streams** may be closed or full: the output folder is written all the same.
- **Memory**: loading takes about 300 MB of address space, solving 0.6 to 1 GB. With less, one line says so (exit code
  1); a solver that never returns is ended after three time limits and a minute.

### Exit codes

| exit code | meaning |
|---|---|
| 0 | solved, or every check holds |
| 1 | a bug in ccm_opt |
| 2 | bad input: all defects are listed with key path and line, nothing is written |
| 3 | no plan, with [the reason and what would help](no-plan.md); or a plan that the verifier rejects |
| 4 | a verified plan, written, that [the simulated arm did not follow](dynamics.md#the-verdict) |
| 5 | a verified plan, written, that leaves out [goals in free order](problem-file.md#goals-in-free-order) |
| 130 | cancelled |
"""
SHARED = ("as_json", "quiet", "verbose")
"""Options of every command, which stand at the end of the page."""
SHORTER = {
    "problems/*.toml --out runs": "problems/open*.toml --out runs",
    "--step 0.05": "--step 0.4 --headings 2 --no-pictures",
    "--payload 0.2": "--payload 0.001",
    "draw runs/* --figure mp4": "draw runs/swan-neck --figure curves",
}
"""What the tests run in place of examples that would take long."""
PIPE = "\\|"
"""A bar inside a table."""
SERVES = "a server, which runs until it is stopped; `tests/test_view.py` starts it"


def command_page() -> str:
    """The whole page."""
    commands = [command for command in app.registered_commands if not command.hidden]
    return "\n".join([HEAD, *map(_section, commands), _shared_section(commands[0])])


@dataclass(frozen=True)
class Parameter:
    """An argument or an option of a command, as its function declares it.

    Attributes:
        key: name of the function's parameter.
        kind: of one value.
        declared: what the command line is told of it.
        default: of the function's parameter.
    """

    key: str
    kind: Any
    declared: ArgumentInfo | OptionInfo
    default: object

    @property
    def words(self) -> str:
        """As it is written on a command line."""
        if isinstance(self.declared, ArgumentInfo):
            return f"`{self.declared.metavar or self.key.upper()}`"
        # In an annotation Typer takes the first name of an option for its default.
        declared = [name for name in (self.declared.default, *(self.declared.param_decls or ())) if name is not ...]
        names = ", ".join(f"`{name}`" for name in declared or [f"--{self.key.replace('_', '-')}"])
        values = get_args(self.kind) if get_origin(self.kind) is Literal else self._members()
        if values:
            return " ".join([names, " \\| ".join(f"`{value}`" for value in values)])
        kinds = {bool: "", int: " INTEGER", float: " NUMBER", str: " TEXT", Path: " PATH"}
        return names + (f" {self.declared.metavar}" if self.declared.metavar else kinds[self.kind])

    def _members(self) -> list[str]:
        return [member.value for member in self.kind] if isinstance(self.kind, EnumType) else []

    @property
    def default_words(self) -> str:
        """What holds without it."""
        if isinstance(self.declared.show_default, str):
            return self.declared.show_default
        if self.default is inspect.Parameter.empty:
            return "required"
        return "" if self.default in {None, False} else f"`{self.default}`"

    @property
    def row(self) -> str:
        """Its row of a table."""
        return f"| {self.words} | {(self.declared.help or '').replace('|', PIPE)} | {self.default_words} |"


def parameters(command: CommandInfo) -> list[Parameter]:
    """The arguments and options of a command, in their order."""
    signature = inspect.signature(command.callback or app)
    found = []
    for key, parameter in signature.parameters.items():
        kind, declared = get_args(parameter.annotation)[:2]
        found.append(Parameter(key, _one_of(kind), declared, parameter.default))
    return found


def _one_of(kind: Any) -> Any:
    """The kind of one value: without None, and of a list that of its entries."""
    kinds = [each for each in get_args(kind) if each is not NoneType]
    return kind if not kinds or get_origin(kind) is Literal else _one_of(kinds[0])


def _section(command: CommandInfo) -> str:
    own = [parameter for parameter in parameters(command) if parameter.key not in SHARED]
    arguments = [parameter.words.strip("`") for parameter in own if isinstance(parameter.declared, ArgumentInfo)]
    usage = " ".join(["ccm-opt", str(command.name), *arguments, "[OPTIONS]"])
    table = ["| argument or option | meaning | default |", "|---|---|---|", *(parameter.row for parameter in own), ""]
    summary = inspect.getdoc(command.callback)
    return "\n".join([f"## `{command.name}`\n", f"{summary}\n", f"```text\n{usage}\n```\n", *table, _examples(command)])


def _examples(command: CommandInfo) -> str:
    lines = [line.strip() for line in (command.epilog or "").splitlines()]
    examples = [line for line in lines if line and line != "Examples:"]
    replaced = [(old, new) for old, new in SHORTER.items() if any(old in line for line in examples)]
    block = ["```sh", *examples, "```\n"]
    if command.name == "view":
        block = [f"<!-- not run: {SERVES} -->", *block]
    elif command.name == "compare":
        block = ["<!-- only read: compares for a minute -->", *block]
    elif command.name == "size":
        block = ["<!-- only read: seeks sizes for minutes -->", *block]
    elif replaced:
        block = ["<!-- run with: " + "\n".join(f"{old} => {new}" for old, new in replaced) + " -->", *block]
    return "\n".join(block)


def _shared_section(command: CommandInfo) -> str:
    shared = [parameter for parameter in parameters(command) if parameter.key in SHARED]
    rows = [f"| {parameter.words} | {parameter.declared.help} |" for parameter in shared]
    return "\n".join(["## Options of every command\n", "| option | meaning |", "|---|---|", *rows, ""])
