"""Maps from the front door."""

import networkx as nx
import pytest

import mrp_sumo as ms


@pytest.fixture(scope="module")
def office():
    return ms.load_map("office")


def test_map_says_size_components_and_findings(office):
    assert repr(office) == "<Map office: 29 vertices, 32 edges, 1 component, 21.5 x 12.0 m, 0 findings>"
    assert str(office).splitlines()[0] == "Map office"
    assert office.num_components == 1
    assert office.size_m == pytest.approx((21.5, 12.0), abs=0.05)


def test_findings_are_told_one_by_one(tmp_path):
    grid = tmp_path / "pieces.map"
    grid.write_text("type octile\nheight 1\nwidth 5\nmap\n..@..\n")
    site = ms.load_map(grid)
    assert "1 finding>" in repr(site) and "2 components" in repr(site)
    assert "several components" in str(site) and "several components" in site._repr_html_()


def test_html_cannot_be_broken_by_names(office):
    from dataclasses import replace

    assert "<script>" not in replace(office, name="<script>")._repr_html_()


def test_map_is_drawn_for_notebooks_and_files(office, tmp_path):
    picture = office.plot()
    assert picture._repr_png_().startswith(b"\x89PNG")
    assert picture.write(tmp_path / "office.svg").read_text().count("<svg") == 1
    with pytest.raises(ms.MrpSumoError, match=r"ends in \.png or \.svg"):
        picture.write(tmp_path / "office.jpg")


def test_map_becomes_a_graph_of_networkx(office):
    graph = office.to_networkx()
    lobby, pantry = office.nav.vertex_of_name["lobby"], office.nav.vertex_of_name["pantry"]
    assert (len(graph), graph.number_of_edges()) == (office.nav.num_vertices, office.nav.num_lanes)
    assert nx.has_path(graph, lobby, pantry)
    assert graph.nodes[lobby]["name"] == "lobby"


@pytest.mark.parametrize(
    ("name", "more", "line"),
    [
        ("ofice", {}, "no map 'ofice': neither a file nor a bundled map (did you mean 'office'?)"),
        ("office", {"level": "L9"}, "office.building.yaml has no level 'L9' (known: L1)"),
        ("office", {"snap_m": -1}, "load_map: snap_m: found -1, expected greater than 0"),
    ],
)
def test_refusal_is_one_line(name, more, line):
    with pytest.raises(ms.MrpSumoError) as caught:
        ms.load_map(name, **more)
    assert str(caught.value) == line


def test_map_as_loaded_is_the_map_of_a_scenario(office):
    whole = ms.load_map(office.path, largest_component=True)
    problem = ms.problem(ms.Scenario(map=whole, robots=2))
    assert problem.setup.scenario.map == whole.choice
    assert repr(problem.site) == repr(office)


def test_graph_of_networkx_becomes_a_map_that_is_planned_on(tmp_path):
    site = ms.save_map(ms.NavGraph.from_networkx(nx.grid_2d_graph(3, 4)), tmp_path / "grid.nav.yaml")
    assert (site.nav.num_vertices, site.nav.num_edges, site.num_components) == (12, 17, 1)
    problem = ms.problem(ms.Scenario(site, 3, "pibt", discretisation={"kind": "roadmap", "cell_m": 1.0}))
    assert problem.graph.num_vertices == 12 and ms.judge(problem, ms.plan(problem))


def test_losses_of_a_format_are_warnings(office, tmp_path):
    with pytest.warns(UserWarning, match=r"office\.map: lost: "):
        assert ms.save_map(office, tmp_path / "office.map").nav.kind == "grid"


def test_format_that_is_not_read_back_is_refused(office, tmp_path):
    with pytest.raises(ms.MrpSumoError, match=r"^office\.geojson: expected a name that ends in \.nav\.yaml or \.map$"):
        ms.save_map(office, tmp_path / "office.geojson")
