"""The cheapest pose of a robot's base for a job whose goals are poses of the tool."""

from energy_opt.placement.placement import Placement, PlaceRequest
from energy_opt.placement.search import place

__all__ = ["PlaceRequest", "Placement", "place"]
