"""Pages of the JSON documents, from dynreg/schemas/."""

import json
import re
from pathlib import Path

SCHEMAS = Path(__file__).parents[2] / "dynreg" / "schemas"


def pages() -> dict[str, str]:
    """{page: text}: a list of all documents, and one page for each."""
    schemas = {
        path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(SCHEMAS.glob("*.json"))
    }
    made = {f"schemas/{name}.md": _page(name, schema) for name, schema in schemas.items()}
    rows = [f"| [{name}]({name}.md) | {_sentence(schema)} |" for name, schema in schemas.items()]
    return {
        "schemas/index.md": "# JSON documents\n\n`--json` prints one of these documents. `dynreg/schemas/` has each as "
        "a JSON schema.\n\n| document | what it is |\n|---|---|\n" + "\n".join(rows) + "\n",
        **made,
    }


def _page(name: str, schema: dict) -> str:
    kinds = {"": schema, **schema.get("$defs", {})}
    parts = [f"# {schema['properties']['schema']['const']}"]
    for kind, described in kinds.items():
        if kind:
            parts.append(f"## {kind}")
        parts.append(_prose(described))
        if "properties" in described:
            parts.append(_keys(described, kinds))
        elif "enum" in described:
            parts.append("One of " + ", ".join(f"`{value}`" for value in described["enum"]) + ".")
    return "\n\n".join(filter(None, parts)) + "\n"


def _prose(schema: dict) -> str:
    """What the class says of itself, without what it says of single keys."""
    text, keys = _parted(schema)
    return _escaped(text[: keys[0].start()] if keys else text).strip()


def _keys(schema: dict, kinds: dict[str, dict]) -> str:
    said = _meanings(schema)
    rows = [
        f"| `{key}` | {_type(value)} | {_escaped(said.get(key) or _of_kind(value, kinds))} |"
        for key, value in schema["properties"].items()
    ]
    return "| key | type | meaning |\n|---|---|---|\n" + "\n".join(rows)


def _meanings(schema: dict) -> dict[str, str]:
    """{key: what the class says of it}, as in "low, high : ends of the interval. unit : of both."."""
    text, keys = _parted(schema)
    ends = [*(key.start() for key in keys[1:]), len(text)]
    said = {}
    for key, end in zip(keys, ends, strict=False):
        meaning = text[key.end() : end].strip().rstrip(";.") + "."
        said |= dict.fromkeys(key[1].split(", "), meaning[0].upper() + meaning[1:])
    return said


def _of_kind(value: dict, kinds: dict[str, dict]) -> str:
    """The first sentence about the kind of object that a key holds; "" for numbers and texts."""
    found = re.search(r'"#/\$defs/(\w+)"', json.dumps(value))
    return (_parted(kinds[found[1]])[0].partition(". ")[0].rstrip(".") + ".") if found else ""


def _parted(schema: dict) -> tuple[str, list[re.Match]]:
    """The description in one line, and where it begins to speak of keys."""
    text = " ".join(schema.get("description", "").split())
    found = re.finditer(r"(?:^|(?<=[.;] ))(\w+(?:, \w+)*) : ", text)
    return text, [one for one in found if set(one[1].split(", ")) <= set(schema.get("properties", ()))]


def _type(value: dict) -> str:
    if "$ref" in value:
        kind = value["$ref"].rpartition("/")[2]
        return f"[{kind}](#{kind.lower()})"
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{choice}`" for choice in value["enum"])
    for several in ("anyOf", "oneOf", "allOf"):
        if several in value:
            return " or ".join(dict.fromkeys(_type(one) for one in value[several]))
    if value.get("type") == "array":
        return f"list of {_type(value.get('items', {}))}"
    if value.get("type") == "object" and isinstance(value.get("additionalProperties"), dict):
        return f"object of {_type(value['additionalProperties'])}"
    return value.get("type", "any")


def _sentence(schema: dict) -> str:
    return _escaped(" ".join(schema.get("description", "").split("\n\n")[0].split()))


def _escaped(text: str) -> str:
    return text.replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;").replace("|", "\\|")
