"""Content of a map that has no effect here: known, kept where a format can hold it, and reported in one line."""

from mrp_sumo.maps.map import Map

OF_VERTICES = {  # options that are read, by why nothing comes of them
    "dock_name": "docking takes no time of its own",
    "merge_radius": "robots start on vertices",
    "is_cleaning_zone": "",
    "human_goal_set_name": "",
    "spawn_robot_name": "a scenario says where robots start",
}


def unused(map_: Map) -> str:
    """One line, '' where everything that the map says is used."""
    lines = list(map_.building.unused) if map_.building else []
    for option, why in OF_VERTICES.items():
        if count := sum(bool(options.get(option)) for options in map_.nav.vertex_options):
            lines.append(f"{option}: {count}{f' ({why})' if why else ''}")
    return f"not used: {', '.join(lines)}" if lines else ""
