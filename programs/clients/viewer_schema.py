"""JSON schemas of recorded messages, simplified for viewers."""

from typing import Any

import msgspec


def viewer_schema(kind: type) -> dict[str, Any]:
    """JSON schema of `kind` in the form that the simplest viewers need.

    The root is an object, every node has one `type`, every object has `properties`, and there is no
    `$ref`. A nullable value has the schema of its other type.
    """
    (schema,), definitions = msgspec.json.schema_components([kind], ref_template="{name}")

    def plain(node: dict[str, Any]) -> dict[str, Any]:
        if "$ref" in node:
            return plain(definitions[node["$ref"]])
        if "anyOf" in node:
            return plain(next(one for one in node["anyOf"] if one.get("type") != "null"))
        if "enum" in node:
            return {"type": "string", **node}
        if node.get("type") == "array":
            return {**node, "items": plain(node["items"])}
        if node.get("type") == "object":
            fields = node.get("properties", {})
            return {**node, "properties": {name: plain(one) for name, one in fields.items()}}
        return node

    return plain(schema)
