"""The kinds of plug-ins: what each has to offer, and where ours are listed.

Faces and tables are written as 'module:attribute', so that looking at this table imports nothing.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """A kind of plug-in.

    The face is a Protocol; each of its methods, properties and annotated attributes is one that a plug-in must have. A Protocol
    with `__call__` is a function's. The table maps names to places ('module:attribute') or to the plug-ins themselves; it may be one of
    tables by kind, as other packages have it.
    """

    name: str  # plural: its key in tables, and its word for `mrp-sumo list`
    one: str  # in messages
    face: str = ""
    ours: str = ""  # the table of those that come with this program
    made: bool = True  # a class that is made with parameters; otherwise what is named is the plug-in itself


KINDS = {
    kind.name: kind
    for kind in (
        Kind("planners", "planner", "mrp_sumo.planning.protocol:Planner", "planners:PLUGINS"),
        Kind("step_planners", "step-wise planner", "mrp_sumo.planning.step_wise:StepPlanner", "planners:PLUGINS"),
        Kind("assigners", "assigner", "mrp_sumo.planning.protocol:Assigner", "planners:PLUGINS"),
        Kind("dispatchers", "dispatcher", "mrp_sumo.drive.dispatcher:Dispatcher", "mrp_sumo.drive.dispatchers:OURS"),
        Kind("policies", "execution policy", "mrp_sumo.drive.policy:Policy", "mrp_sumo.drive.policy:OURS"),
        Kind("metrics", "metric", ours="mrp_sumo.metrics.registry:BY_NAME", made=False),
        Kind("readers", "map reader", "mrp_sumo.maps.readers.reader:Reader", "mrp_sumo.maps.readers.registry:OURS"),
    )
}
