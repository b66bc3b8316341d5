import pytest

from mrp_sumo.plugins import trust


@pytest.fixture(autouse=True, scope="session")
def own_plug_ins_are_trusted(tmp_path_factory):
    """Plug-in files that tests write may run, and the user's own list of folders is left alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        trust.trust_everything()
        yield


@pytest.fixture
def nothing_trusted(monkeypatch, tmp_path):
    """As a user begins: no program is trusted."""
    monkeypatch.setattr(trust, "_everything", False)
    monkeypatch.setattr(trust, "_named", set())
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
