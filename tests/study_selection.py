"""What runs on Postgres with the studies only: files whose subject is an answer's form, a page or a refusal, not the database.

On SQLite they run with ``make test``. What locks, folds, migrates, queues or recovers is asked on both databases there. One test
of another file says it with the marker ``postgres_in_study``.
"""

import pytest

ON_POSTGRES_WITH_THE_STUDIES = tuple(
    f"tests/service/test_{name}.py"
    for name in [
        "administration_pages",
        "alarm_pages",
        "alarm_plans",
        "alarms",
        "api",
        "audit",
        "circuits",
        "contradictions",
        "engineer_pages",
        "every_status",
        "exports",
        "fleet",
        "fleet_page",
        "fluids",
        "forecast",
        "identity",
        "job_documents",
        "mappings",
        "nobody_gets_in",
        "oidc",
        "overviews",
        "page_forms",
        "pages",
        "pump_filters",
        "pump_types",
        "reader_units",
        "record_marks",
        "reference_curve",
        "registry",
        "registry_files",
        "registry_operators",
        "release_before",
        "remarks",
        "retention",
        "shapes_of_exports",
        "sign_in",
        "simulate_flight",
        "threshold_pages",
        "thresholds",
        "trend_pages",
        "type_without_twin",
        "upload",
        "upload_page",
        "words_of_files",
    ]
)


def mark_studies(items: list[pytest.Item]) -> None:
    """Mark the Postgres side of these files, and of tests with the marker, as studies."""
    for item in items:
        if "postgres" not in item.nodeid.partition("[")[2]:
            continue
        if item.nodeid.startswith(ON_POSTGRES_WITH_THE_STUDIES) or item.get_closest_marker("postgres_in_study"):
            item.add_marker(pytest.mark.study)
