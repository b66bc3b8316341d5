"""Who writes the arrays of a running execution, read from the sources: the reader of tests/drive/test_owners.py.

An array of a record is known by the record's name: `visits`, `state.grants`, `self.ledger.visits`, or a parameter with the record's
class. It is written by assignments to its elements, in-place operations, `out=`, methods and functions of NumPy that write, and by
functions and kernels that write their parameters, which is followed from call to call.
"""

import ast
from collections import defaultdict

NAMES = {  # of records, as variables, parameters and attributes have them; also with "_" before them
    "visits": "Visits",
    "needs": "VisitNeeds",
    "state": "State",
    "motion": "Motion",
    "grants": "Grants",
    "holds": "Holds",
    "claims": "Claims",
    "waits": "Waits",
    "yielding": "Yielding",
    "conditions": "Conditions",
    "margin": "Margin",
    "facilities": "Facilities",
    "lifts": "Lifts",
    "doors": "Doors",
    "people": "PeopleState",
    "seen": "PeopleState",
    "machines": "Machines",
    "among_people": "AmongPeople",
    "floor_lanes": "FloorLanes",
    "log": "Log",
    "entries": "Entries",
}
METHODS = {"fill", "sort", "partition", "put", "resize", "itemset", "byteswap", "setfield"}  # of arrays, which write
FIRST = {
    "copyto",
    "put",
    "place",
    "putmask",
    "put_along_axis",
    "fill_diagonal",
    "at",
    "shuffle",
}  # functions that write their first argument


class Records(ast.NodeVisitor):
    """The fields of NamedTuples in some sources, and which of them are records again."""

    def __init__(self, sources):
        self.fields = {}
        for text in sources.values():
            for node in ast.walk(ast.parse(text)):
                if (
                    isinstance(node, ast.ClassDef)
                    and node.name in NAMES.values()
                    and any(ast.unparse(b) == "NamedTuple" for b in node.bases)
                ):
                    of = {each.target.id: ast.unparse(each.annotation) for each in node.body if isinstance(each, ast.AnnAssign)}
                    self.fields[node.name] = of

    def of(self, record, field):
        """What a field of a record is: a record, or an array."""
        kind = self.fields[record][field]
        return ("record", kind) if kind in self.fields else ("array", record, field)


class Function:
    """What a function writes: arrays of records, and its parameters, or what these have."""

    def __init__(self, path, node, records, properties):
        self.path, self.node, self.records, self.properties = path, node, records, properties
        self.arrays, self.written, self.calls = set(), set(), []  # (record, field, path); (parameter, field or ""); calls with arguments
        self.names = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        self.known = {}
        for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs):
            kind = ast.unparse(each.annotation) if each.annotation else None
            by_name = NAMES.get(each.arg) if kind is None else kind if kind in records.fields else None
            self.known[each.arg] = {("record", by_name)} if by_name in records.fields else {("parameter", each.arg)}
        for statement in node.body:
            self.read(statement)

    def find(self, node):
        """What an expression may be."""
        if isinstance(node, ast.Name):
            return self.known.get(node.id, set())
        if isinstance(node, ast.IfExp):
            return self.find(node.body) | self.find(node.orelse)
        if isinstance(node, (ast.Tuple, ast.List)):
            return set().union(*map(self.find, node.elts)) if node.elts else set()
        if isinstance(node, (ast.Starred, ast.NamedExpr)):
            return self.find(node.value)
        if isinstance(node, ast.Subscript):
            return self.find(node.value) if any(isinstance(each, ast.Slice) for each in ast.walk(node.slice)) else set()
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "getattr":
            return {("array", each[1], "*") for each in self.find(node.args[0]) if each[0] == "record"}
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
            return self.find(node.func.value)
        if isinstance(node, ast.Attribute):
            return self.attribute(node)
        return set()

    def attribute(self, node):
        base, result = self.find(node.value), set()
        for each in base:
            if each[0] == "record" and node.attr in self.records.fields[each[1]]:
                result.add(self.records.of(each[1], node.attr))
            elif each[0] == "parameter" and len(each) == 2:
                result.add(("parameter", each[1], node.attr))
        if not any(each[0] in ("record", "array") for each in result | base):
            name = node.attr.lstrip("_")
            if NAMES.get(name) in self.records.fields:
                result.add(("record", NAMES[name]))
            result |= self.properties.get(node.attr, set())
        return result

    def write(self, node):
        for each in self.find(node):
            if each[0] == "array":
                self.arrays.add((each[1], each[2], self.path))
            elif each[0] == "parameter":
                self.written.add((each[1], each[2] if len(each) > 2 else ""))

    def read(self, node):
        """Go through a statement in the order of its text."""
        if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Lambda)):
            if isinstance(node, ast.FunctionDef):
                for statement in node.body:
                    self.read(statement)
            return
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            self.read(node.value)
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                self.bind(target, node.value)
            return
        if isinstance(node, ast.AugAssign):
            self.read(node.value)
            self.write(node.target.value if isinstance(node.target, ast.Subscript) else node.target)
            return
        if isinstance(node, ast.For):
            self.read(node.iter)
            self.bind(node.target, node.iter)
            for each in (*node.body, *node.orelse):
                self.read(each)
            return
        if isinstance(node, ast.Call):
            self.call(node)
        for child in ast.iter_child_nodes(node):
            self.read(child)

    def bind(self, target, value):
        if isinstance(target, (ast.Tuple, ast.List)):
            alike = isinstance(value, (ast.Tuple, ast.List)) and len(value.elts) == len(target.elts)
            for k, each in enumerate(target.elts):
                self.bind(each, value.elts[k] if alike else ast.Constant(None))
        elif isinstance(target, ast.Subscript):
            self.write(target.value)
        elif isinstance(target, ast.Name):
            self.known[target.id] = self.find(value)

    def call(self, node):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if isinstance(node.func, ast.Attribute) and name in METHODS:
            self.write(node.func.value)
        if name in FIRST and node.args and isinstance(node.func, ast.Attribute):
            self.write(node.args[0])
        for keyword in node.keywords:
            if keyword.arg == "out":
                self.write(keyword.value)
        is_method = isinstance(node.func, ast.Attribute)
        arguments = [(k, self.find(each)) for k, each in enumerate(node.args)]
        arguments += [(keyword.arg, self.find(keyword.value)) for keyword in node.keywords]
        self.calls.append((name, is_method, [(place, what) for place, what in arguments if what]))

    def take_over(self, callee, is_method, arguments):
        """Write what a function writes that is called with these arguments. Returns whether that was unknown."""
        before = len(self.arrays), len(self.written)
        shift = 1 if is_method and callee.names[:1] == ["self"] else 0
        for place, what in arguments:
            name = place if isinstance(place, str) else callee.names[place + shift] if place + shift < len(callee.names) else None
            for parameter, field in callee.written:
                if parameter != name:
                    continue
                for each in what:
                    if each[0] == "array" and not field:
                        self.arrays.add((each[1], each[2], self.path))
                    elif each[0] == "record" and field in self.records.fields[each[1]]:
                        self.arrays.add((each[1], field, callee.path))
                    elif each[0] == "parameter" and not (field and len(each) > 2):
                        self.written.add((each[1], field or (each[2] if len(each) > 2 else "")))
        return before != (len(self.arrays), len(self.written))


def writers(sources):
    """The files that write each array: {(record, field): {path}}.

    Parameters
    ----------
    sources
        The texts by path; the records among them.
    """
    records = Records(sources)
    nodes = [(path, node) for path, text in sources.items() for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    properties = {}
    for path, node in nodes:
        if any(ast.unparse(each) == "property" for each in node.decorator_list) and isinstance(node.body[-1], ast.Return):
            arrays = {each for each in Function(path, node, records, {}).find(node.body[-1].value) if each[0] == "array"}
            if arrays:
                properties[node.name] = arrays
    functions = [Function(path, node, records, properties) for path, node in nodes]
    by_name = defaultdict(list)
    for function in functions:
        by_name[function.node.name].append(function)
    changed = True
    while changed:
        changed = False
        for function in functions:
            for name, is_method, arguments in function.calls:
                for callee in by_name[name]:
                    changed |= function.take_over(callee, is_method, arguments)
    written = defaultdict(set)
    for function in functions:
        for record, field, path in function.arrays:
            for each in records.fields[record] if field == "*" else [field]:
                written[record, each].add(path)
    return dict(written)
