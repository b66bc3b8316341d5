"""The front door for Python: `import mrp_sumo as ms` gives what stands here, loaded when it is first used."""
