"""Rewrites the blocks of the documentation that follow from the code: `python docs/generated_blocks.py`.

A block stands between `<!-- generated: NAME -->` and `<!-- end -->`. Each is a function of the code alone (pydantic
schemas, the committed OpenAPI description, the table of transitions), so that a test can compare the pages with it.
"""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"(<!-- generated: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def _type(field: dict[str, Any], definitions: dict[str, Any]) -> str:
    """A JSON schema's type in a few words, limits included."""
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[-1]
        target = definitions[name]
        return _type(target, definitions) if "enum" in target else f"[{name}](#{name.lower()})"
    if "anyOf" in field:
        return " or ".join(_type(item, definitions) for item in field["anyOf"])
    if "oneOf" in field:
        return " or ".join(_type(item, definitions) for item in field["oneOf"])
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    if field.get("type") == "null":
        return "none"
    if field.get("type") == "array":
        if "prefixItems" in field:
            return f"{len(field['prefixItems'])} × {_type(field['prefixItems'][0], definitions)}"
        return f"list of {_type(field.get('items', {}), definitions)}"
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    limits = ", ".join(f"{sign} {field[key]:.12g}" for key, sign in signs.items() if key in field)
    names = {"number": "number", "integer": "integer", "string": "text", "boolean": "yes or no", "object": "object"}
    return " ".join(item for item in (names.get(field.get("type", ""), "any"), limits) if item)


def _default(field: dict[str, Any], required: bool) -> str:
    if required:
        return "required"
    value = field.get("default")
    if value in ([], {}, None, ""):
        return "–"
    if isinstance(value, list) and all(isinstance(one, int | float) for one in value):
        return f"`{json.dumps(value)}`"
    if isinstance(value, dict | list):
        return "see there"
    return f"`{json.dumps(value)}`"


def _schema_tables(schema: dict[str, Any], name: str) -> Iterator[str]:
    definitions = schema.get("$defs", {})
    models = {name: schema} | {key: value for key, value in definitions.items() if "properties" in value}
    for title, model in models.items():
        yield f"### {title}\n"
        yield "| field | type | default | |"
        yield "|---|---|---|---|"
        for field, value in model["properties"].items():
            default = _default(value, field in model.get("required", []))
            text = " ".join(str(value.get("description", "")).split()).replace("|", "\\|")
            yield f"| `{field}` | {_type(value, definitions)} | {default} | {text} |"
        yield ""


def recipe() -> str:
    """The recipe's fields, from its pydantic model."""
    from acquisition.models.recipe import Recipe

    return "\n".join(_schema_tables(Recipe.model_json_schema(), "Recipe")).strip()


def cell_file() -> str:
    """The cell file's fields, from its pydantic models."""
    from acquisition.models.cell_config import CellConfig

    return "\n".join(_schema_tables(CellConfig.model_json_schema(), "CellConfig")).strip()


def calibration() -> str:
    """The calibration's fields, from its pydantic model."""
    from acquisition.models.calibration import Calibration

    return "\n".join(_schema_tables(Calibration.model_json_schema(), "Calibration")).strip()


def routes() -> str:
    """Every route of the service, from the committed OpenAPI description."""
    description = json.loads((ROOT / "api" / "openapi.json").read_text(encoding="utf-8"))
    rows = ["| method | path | |", "|---|---|---|"]
    for path, methods in description["paths"].items():
        for method, operation in methods.items():
            sentence = str(operation.get("description", "")).split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
            rows.append(f"| {method.upper()} | `{path}` | {sentence} |")
    return "\n".join(rows)


def problems() -> str:
    """Every problem code with its HTTP status, from the one table of codes."""
    from acquisition.models.problem_table import PROBLEMS

    rows = ["| code | status | |", "|---|---|---|"]
    rows += [f"| `{code}` | {entry.status} | {entry.title} |" for code, entry in PROBLEMS.items()]
    return "\n".join(rows)


def transitions() -> str:
    """The state diagram of a session in mermaid's language, from the table of transitions."""
    from acquisition.session_state import ENDED, TRANSITIONS, State

    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {State.CREATED}"]
    lines += [f"    {state} --> {target}: {trigger}" for (state, trigger), target in TRANSITIONS.items()]
    lines += [f"    {state} --> [*]" for state in State if state in ENDED]
    return "\n".join([*lines, "```"])


def _moved(number: dict[str, Any]) -> tuple[str, str]:
    """How error and rms e/σ change where a number is halved and doubled, each ± its standard error, or what each error
    of scenes of its own then is; or why not."""
    why = number.get("not measured", "")
    shown = [f"not measured{why and ': '}{why}"] * 2
    for column, change in enumerate(("halved", "doubled")):
        if "usual" in number:
            shown[column] = _means(number, change)
        elif change in number:
            shown[column] = ", ".join(
                f"{name} {value:.3f} ± {error:.3f}" for name, (value, error) in number[change].items()
            )
    return shown[0], shown[1]


def _means(number: dict[str, Any], change: str) -> str:
    """Means of each error over a number's own scenes, as the number is and changed, and how many scenes change."""
    errors = [
        f"{name} {number['usual'][name]:.4g} → {value:.4g} ± {error:.2g}"
        for name, (value, error, _) in number[change].items()
    ]
    changed = max(count for _, _, count in number[change].values())
    return f"{'; '.join(errors)} ({changed} of {number['scenes']} change)"


def _own_scenes(numbers: dict[str, dict[str, Any]]) -> list[str]:
    """What the scenes are of numbers that have scenes of their own."""
    commits = sorted({str(one["commit"]) for one in numbers.values()})
    lines = [
        "What these captures do not tell, on scenes of its own: `python -m tests.unseen sensitivity --numbers own "
        f"--write`, {max(one['date'] for one in numbers.values())}, commit {' and '.join(commits)}:",
        "",
    ]
    by_scenes: dict[tuple[str, int], list[str]] = {}
    for key, one in numbers.items():
        by_scenes.setdefault((one["bench"], one["scenes"]), []).append(f"`{key}`")
    return lines + [f"- {', '.join(keys)}: {count} {what}." for (what, count), keys in by_scenes.items()]


def tuned_numbers() -> str:
    """Every tuned number of solver and planner, by module, and how error and rms e/σ move where that was measured."""
    from tests.tuned_numbers import settings

    measured = json.loads((ROOT / "docs" / "reference" / "sensitivity.json").read_text(encoding="utf-8"))
    moved = {key: figures for part in measured.values() for key, figures in part["numbers"].items()}
    lines = [
        f"Halved and doubled, the {part}'s: `python -m tests.unseen sensitivity --numbers "
        f"{'planner' if part == 'planner' else 'all'} --write`, {one['date']}, commit {' and '.join(one['commits'])}; "
        f"geometric means over the captures {', '.join(one['captures'])}."
        for part, one in measured.items()
        if part != "own"
    ]
    if "own" in measured:
        lines += _own_scenes(measured["own"]["numbers"])
    module = ""
    for one in settings():
        if one.module != module:
            module = one.module
            lines += [
                "",
                f"### {module}",
                "",
                "| number | value | unit | meaning | source or reason | halved | doubled |",
            ]
            lines.append("|---|---|---|---|---|---|---|")
        halved, doubled = _moved(moved.get(one.key, {}))
        meaning, source = (text.replace("|", "\\|") for text in (one.meaning, one.source or "none is recorded"))
        lines.append(f"| `{one.name}` | {one.value} | {one.unit} | {meaning} | {source} | {halved} | {doubled} |")
    return "\n".join(lines).strip()


GENERATED = {
    "recipe": recipe,
    "cell-file": cell_file,
    "calibration": calibration,
    "routes": routes,
    "problems": problems,
    "transitions": transitions,
    "tuned-numbers": tuned_numbers,
}


def rewritten(text: str) -> str:
    """A page with its generated blocks as the code is now."""
    return BLOCK.sub(lambda block: f"{block[1]}\n{GENERATED[block[2]]()}\n\n{block[3]}", text)


def main() -> None:
    """Rewrites every page that holds a generated block."""
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        now = rewritten(text)
        if now != text:
            page.write_text(now, encoding="utf-8")
            print(page.relative_to(ROOT))


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
