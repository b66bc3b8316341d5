"""A small LIF: a square of four nodes driven round one way, a curve, a charger, a station."""

import copy

TYPE = "maker.series"


def node(name, x, y, **properties):
    return {
        "nodeId": name,
        "mapId": "hall",
        "nodePosition": {"x": x, "y": y},
        "vehicleTypeNodeProperties": [{"vehicleTypeId": TYPE, **properties}],
    }


def edge(tail, head, **properties):
    return {
        "edgeId": f"{tail}-{head}",
        "startNodeId": tail,
        "endNodeId": head,
        "vehicleTypeEdgeProperties": [{"vehicleTypeId": TYPE, "rotationAllowed": False, **properties}],
    }


CHARGE = [{"actionType": "startCharging", "requirementType": "OPTIONAL", "blockingType": "HARD"}]
CURVE = {
    "degree": 2,
    "knotVector": [0, 0, 0, 1, 1, 1],
    "controlPoints": [{"x": 4.0, "y": 0.0}, {"x": 4.0, "y": 4.0, "weight": 0.5}, {"x": 0.0, "y": 4.0}],
}
LIF = {
    "metaInformation": {"projectIdentification": "p", "creator": "c", "exportTimestamp": "2026-01-01T00:00:00.00Z", "lifVersion": "1.0.0"},
    "layouts": [
        {
            "layoutId": "ground",
            "layoutVersion": "1",
            "nodes": [node("A", 0.0, 0.0), node("B", 4.0, 0.0, theta=1.5), node("C", 0.0, 4.0, actions=CHARGE)],
            "edges": [
                edge("A", "B", maxSpeed=1.2),
                edge("B", "C", trajectory=CURVE, rotationAtStartNodeAllowed="NONE"),
                edge("C", "A", vehicleOrientation=3.1415926, loadRestriction={"loaded": False, "unloaded": True}),
            ],
            "stations": [{"stationId": "dock", "interactionNodeIds": ["B"]}],
        }
    ],
}


def lif():
    """One that can be changed."""
    return copy.deepcopy(LIF)


def lif_2():
    """The same as draft 2 says it."""
    result = {"metaInformation": {"lifId": "p", "creator": "c", "exportTimestamp": "2026-01-01T00:00:00.00Z", "lifVersion": "2.0.0"}}
    layout = lif()["layouts"][0]
    kinds = [{"manufacturer": "maker", "seriesName": "series"}]
    for what in layout["nodes"]:
        (params,) = what.pop("vehicleTypeNodeProperties")
        del params["vehicleTypeId"]
        if "actions" in params:
            params["feasibleActions"] = [{k: v for k, v in a.items() if k != "requirementType"} for a in params.pop("actions")]
        what["mobileRobotTypeNodeProperties"] = [{"mobileRobotTypes": kinds, **params}]
    for what in layout["edges"]:
        (params,) = what.pop("vehicleTypeEdgeProperties")
        del params["vehicleTypeId"], params["rotationAllowed"]
        if "maxSpeed" in params:
            params["maximumSpeed"] = params.pop("maxSpeed")
        if "vehicleOrientation" in params:
            params["mobileRobotOrientations"] = [params.pop("vehicleOrientation")]
        what["mobileRobotTypeEdgeProperties"] = [{"mobileRobotTypes": kinds, **params}]
    return result | {"origins": [{"originId": "o", "layouts": [layout]}]}
