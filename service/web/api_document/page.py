"""``/docs``: the OpenAPI document as a page of its own, without any script."""

import json
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from service.answers.documents import JsonObject
from service.web.api_document.document import openapi_document, operations
from service.web.dashboard.frame import html_page

docs_router = APIRouter(include_in_schema=False)


@docs_router.get("/docs", response_class=HTMLResponse)
def docs(request: Request) -> Response:
    """Every call with its parameters, bodies, answers and errors."""
    document = openapi_document(request.app)
    sections: dict[str, list[JsonObject]] = {tag["name"]: [] for tag in document["tags"]}
    for method, path, operation in operations(document):
        tag = operation.get("tags", ["other"])[0]
        sections.setdefault(tag, []).append(_shown(document, method, path, operation))
    words = {tag["name"]: tag["description"] for tag in document["tags"]}
    values = {"request": request, "info": document["info"], "sections": sections, "words": words}
    return html_page("docs.html", 200, values)


def _shown(document: JsonObject, method: str, path: str, operation: JsonObject) -> JsonObject:
    body = operation.get("requestBody", {}).get("content", {})
    return {
        "method": method,
        "path": path,
        "anchor": operation["operationId"],
        "summary": operation.get("summary", ""),
        "description": operation.get("description", ""),
        "parameters": [_parameter(p) for p in operation.get("parameters", [])],
        "body_types": list(body),
        "body": [_schema(document, content) for content in body.values() if content],
        "responses": [_response(document, s, r) for s, r in sorted(operation["responses"].items())],
    }


def _parameter(parameter: JsonObject) -> JsonObject:
    schema = parameter.get("schema", {})
    kinds = [s.get("type") or "" for s in schema.get("anyOf", [schema])]
    choices: list[str] = schema.get("enum") or next((s["enum"] for s in schema.get("anyOf", []) if "enum" in s), [])
    limits = [f"{word} {schema[key]}" for key, word in (("minimum", "from"), ("maximum", "to")) if key in schema]
    return {
        "name": parameter["name"],
        "where": parameter["in"],
        "required": parameter.get("required", False),
        "kind": " or ".join(k for k in kinds if k and k != "null"),
        "words": "; ".join(w for w in (parameter.get("description", ""), ", ".join(choices), " ".join(limits)) if w),
        "default": schema.get("default"),
    }


def _schema(document: JsonObject, content: JsonObject) -> JsonObject:
    schema = content.get("schema", {})
    options = [o for o in schema.get("anyOf", [schema]) if o.get("type") != "null"]
    name = options[0].get("$ref", "").rpartition("/")[2] if options else ""
    found = document["components"]["schemas"].get(name, {})
    required = found.get("required", [])
    fields = [
        {"name": key, "required": key in required, "words": _kind(value)}
        for key, value in found.get("properties", {}).items()
    ]
    example = (found.get("examples") or [content.get("example")])[0]
    return {"name": name, "fields": fields, "example": _text(example)}


def _kind(schema: JsonObject) -> str:
    kinds = [str(s.get("type") or s.get("$ref", "").rpartition("/")[2]) for s in schema.get("anyOf", [schema])]
    choices = schema.get("enum", [])
    return ", ".join(choices) if choices else " or ".join(k for k in kinds if k)


def _response(document: JsonObject, status: str, response: JsonObject) -> JsonObject:
    shared = response.get("$ref", "").rpartition("/")[2]
    if shared:
        # what any call may answer: an example beside each of them would drown the call's own
        response = {"description": document["components"]["responses"][shared]["description"]}
    content = response.get("content", {})
    example = next((c["example"] for c in content.values() if "example" in c), None)
    return {
        "status": status,
        "words": response["description"],
        "types": ", ".join(content),
        "example": _text(example),
    }


def _text(example: Any) -> str:
    return "" if example is None else json.dumps(example, indent=2, ensure_ascii=False)
