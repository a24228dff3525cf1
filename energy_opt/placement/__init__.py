"""The cheapest pose of a robot's base for a job whose goals are poses of the tool."""

from energy_opt.placement.cheapest import place
from energy_opt.placement.placement import Placement, PlaceRequest

__all__ = ["PlaceRequest", "Placement", "place"]
