"""The functions of `import energy_opt`: from flexible arguments to answers that can be saved."""
