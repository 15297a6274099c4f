"""Every page and form in one router."""

from fastapi import APIRouter

from service.web.dashboard.actions import action_router
from service.web.dashboard.administration import administration_router
from service.web.dashboard.alarms import alarm_router
from service.web.dashboard.cards import card_router
from service.web.dashboard.choices import choice_router
from service.web.dashboard.engineer import engineer_router
from service.web.dashboard.fleet import fleet_router
from service.web.dashboard.jobs import job_router
from service.web.dashboard.mappings import mapping_router
from service.web.dashboard.oidc import oidc_router
from service.web.dashboard.pages import page_router
from service.web.dashboard.records import record_router
from service.web.dashboard.registry import registry_router
from service.web.dashboard.sign_in import sign_in_router
from service.web.dashboard.thresholds import threshold_router
from service.web.dashboard.upload import upload_router

dashboard_router = APIRouter()
for _part in (
    fleet_router,
    page_router,
    record_router,
    alarm_router,
    threshold_router,
    upload_router,
    mapping_router,
    engineer_router,
    job_router,
    registry_router,
    administration_router,
    action_router,
    card_router,
    choice_router,
    sign_in_router,
    oidc_router,
):
    dashboard_router.include_router(_part)
