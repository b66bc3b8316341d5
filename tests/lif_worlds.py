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
    found = {"metaInformation": {"lifId": "p", "creator": "c", "exportTimestamp": "2026-01-01T00:00:00.00Z", "lifVersion": "2.0.0"}}
    layout = lif()["layouts"][0]
    kinds = [{"manufacturer": "maker", "seriesName": "series"}]
    for what in layout["nodes"]:
        (given,) = what.pop("vehicleTypeNodeProperties")
        del given["vehicleTypeId"]
        if "actions" in given:
            given["feasibleActions"] = [{k: v for k, v in a.items() if k != "requirementType"} for a in given.pop("actions")]
        what["mobileRobotTypeNodeProperties"] = [{"mobileRobotTypes": kinds, **given}]
    for what in layout["edges"]:
        (given,) = what.pop("vehicleTypeEdgeProperties")
        del given["vehicleTypeId"], given["rotationAllowed"]
        if "maxSpeed" in given:
            given["maximumSpeed"] = given.pop("maxSpeed")
        if "vehicleOrientation" in given:
            given["mobileRobotOrientations"] = [given.pop("vehicleOrientation")]
        what["mobileRobotTypeEdgeProperties"] = [{"mobileRobotTypes": kinds, **given}]
    return found | {"origins": [{"originId": "o", "layouts": [layout]}]}
