"""Events as documents: by which names robots and places appear, and that they come back."""

from mrp_sumo.core.execution import Event
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.io.events import event_document, events_frame, events_of_documents
from tests.worlds import BURGER

OPTIONS = ({"station": "Storage 01"}, {"station": "Point-2"}, {})
DRAWN = nav_graph(
    name="drawn", xy=[(0, 0), (1, 0), (2, 0)], lanes=[(0, 1), (1, 2)], vertex_name=("Point-1", "Point-2", ""), vertex_options=OPTIONS
)
FLEET = fleet_of(BURGER, 1)


def test_an_event_names_the_station_where_that_is_not_the_name_of_its_vertex():
    documents = [event_document(Event(1.0, "goal", 0, vertex), FLEET, DRAWN) for vertex in range(3)]
    assert [d["vertex"] for d in documents] == ["Point-1", "Point-2", "v2"]
    assert [d.get("station") for d in documents] == ["Storage 01", None, None]
    assert events_frame(documents).station[0] == "Storage 01"
    assert [event.vertex for event in events_of_documents(documents, FLEET, DRAWN)] == [0, 1, 2]
