"""The bundled map readers, in the order in which they are asked whether a file is theirs."""

OURS = {
    "movingai_scen": "mrp_sumo.maps.readers.movingai:MovingAiScen",
    "movingai_map": "mrp_sumo.maps.readers.movingai:MovingAiMap",
    "dxf_plan": "mrp_sumo.maps.readers.plan:DxfPlan",
    "svg_plan": "mrp_sumo.maps.readers.plan:SvgPlan",
    "pdf_plan": "mrp_sumo.maps.readers.plan:PdfPlan",
    "picture_plan": "mrp_sumo.maps.readers.plan:PicturePlan",
    "lane_table": "mrp_sumo.maps.readers.tables:LaneTable",
    "sumo_net": "mrp_sumo.maps.readers.sumo_net:SumoNet",
    "opentcs": "mrp_sumo.maps.readers.opentcs:OpenTcs",
    "lif": "mrp_sumo.maps.readers.lif:Lif",
    "rmf_site": "mrp_sumo.maps.readers.site:RmfSite",
    "geojson": "mrp_sumo.maps.readers.geojson:GeoJson",
    "nav2_graph": "mrp_sumo.maps.readers.geojson:Nav2Graph",
    "node_link": "mrp_sumo.maps.readers.tables:NodeLink",
    "rmf_building": "mrp_sumo.maps.readers.rmf.reader:RmfBuilding",
    "rmf_nav_graph": "mrp_sumo.maps.readers.rmf.reader:RmfNavGraph",
    "ros_map": "mrp_sumo.maps.readers.ros_map:RosMap",
}
OF_TEXT = ("movingai_scen", "movingai_map")  # those that look at the text alone, which is quicker than YAML
