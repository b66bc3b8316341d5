"""Small maps in the formats of the industry."""

SITE = {
    "format_version": "0.1",
    "properties": {"name": "clinic"},
    "anchors": {"20": {"Translate2D": [8.0, -1.0]}, "21": {"Translate2D": [8.0, 1.0]}},
    "levels": {
        "1": {
            "properties": {"name": "L1", "elevation": 0.0},
            "anchors": {str(k): {"Translate2D": [2.0 * k, 0.0]} for k in range(4)} | {"9": {"Translate2D": [0.0, 5.0]}},
            "walls": {"30": {"anchors": [0, 9]}},
            "doors": {"31": {"anchors": [2, 9], "name": "gate", "kind": {"DoubleSliding": {}}}},
        },
        "2": {"properties": {"name": "L2", "elevation": 4.0}, "anchors": {"40": {"Translate2D": [2.0, 0.0]}}},
    },
    "lifts": {
        "50": {
            "properties": {"name": "main", "reference_anchors": [20, 21], "cabin": {"Rect": {"width": 2.0, "depth": 1.8}}},
            "cabin_anchors": {"51": {"Translate2D": [0.0, 0.0]}},
        }
    },
    "navigation": {
        "guided": {
            "graphs": {"71": {"name": "one"}, "72": {"name": "two"}},
            "ranking": [71, 72],
            "lanes": {
                "60": {"anchors": [0, 1], "graphs": "All", "forward": {"speed_limit": 0.5}},
                "61": {"anchors": [1, 2], "graphs": {"Only": [71]}, "reverse": "Disable"},
                "62": {"anchors": [1, 3], "graphs": {"AllExcept": [71]}},
                "63": {"anchors": [2, 51], "graphs": "All"},
                "64": {"anchors": [51, 40], "graphs": "All"},
            },
            "locations": {"80": {"anchor": 1, "name": "ward", "tags": ["Charger", "ParkingSpot"], "graphs": "All"}},
        }
    },
}
ROUTE = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": {"id": 0}, "geometry": {"type": "Point", "coordinates": [0.0, 0.0]}},
        {
            "type": "Feature",
            "properties": {"id": 1, "metadata": {"name": "dock"}},
            "geometry": {"type": "Point", "coordinates": [3.0, 0.0]},
        },
        {
            "type": "Feature",
            "properties": {"id": 2, "startid": 0, "endid": 1, "metadata": {"abs_speed_limit": 0.4}},
            "geometry": {"type": "MultiLineString", "coordinates": [[[0.0, 0.0], [0.0, 2.0], [3.0, 0.0]]]},
        },
        {
            "type": "Feature",
            "properties": {"id": 3, "startid": 1, "endid": 0},
            "geometry": {"type": "MultiLineString", "coordinates": [[[3.0, 0.0], [0.0, 0.0]]]},
        },
    ],
}
CSV = "from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways,speed_mps\na,b,0,0,2,0,yes,0.5\nb,c,2,0,2,3,no,\n"
LINK = {
    "directed": True,
    "nodes": [{"id": "a", "x": 0, "y": 0}, {"id": 7, "x_m": 4.0, "y_m": 3.0}],
    "links": [{"source": "a", "target": 7}],
}
MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<model version="7.0.0" name="small">
    <point name="P1" positionX="0" positionY="0" positionZ="0" vehicleOrientationAngle="90.0" type="HALT_POSITION"/>
    <point name="P2" positionX="4000" positionY="0" positionZ="0" vehicleOrientationAngle="NaN" type="PARK_POSITION"/>
    <point name="P3" positionX="4000" positionY="4000" positionZ="0" type="HALT_POSITION"/>
    <path name="P1 --- P2" sourcePoint="P1" destinationPoint="P2" length="4000" maxVelocity="1500" maxReverseVelocity="300" locked="false"/>
    <path name="P2 --- P3" sourcePoint="P2" destinationPoint="P3" length="9000" maxVelocity="1000" maxReverseVelocity="0" locked="false">
        <pathLayout connectionType="BEZIER" layerId="0"><controlPoint x="120" y="0"/><controlPoint x="120" y="-80"/></pathLayout>
    </path>
    <path name="P3 --- P1" sourcePoint="P3" destinationPoint="P1" length="5657" maxVelocity="1000" maxReverseVelocity="0" locked="false"/>
    <path name="shut" sourcePoint="P3" destinationPoint="P2" length="4000" maxVelocity="1000" maxReverseVelocity="0" locked="true"/>
    <locationType name="Charger"><allowedOperation name="CHARGE"/><allowedOperation name="NOP"/></locationType>
    <location name="Socket" positionX="0" positionY="0" positionZ="0" type="Charger" locked="false"><link point="P3"/></location>
    <block name="B" type="SINGLE_VEHICLE_ONLY"><member name="P2 --- P3"/><member name="P1"/></block>
    <visualLayout name="V" scaleX="50.0" scaleY="50.0"/>
</model>
"""
