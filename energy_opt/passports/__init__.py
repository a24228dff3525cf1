"""An arm's electrical passport: standby, copper loss and friction with intervals and sources."""
