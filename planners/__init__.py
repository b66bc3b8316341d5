"""The planners and assigners that come with mrp_sumo: name -> 'module:class', loaded on first use.

Other packages register a table like `PLUGINS` under the entry-point group `mrp_sumo.planners`.
"""

PLUGINS = {
    "planners": {},
    "assigners": {},
}
