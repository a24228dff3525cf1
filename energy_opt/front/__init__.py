"""The front door: what `import energy_opt` offers, from arguments as people have them to answers that can be saved."""
