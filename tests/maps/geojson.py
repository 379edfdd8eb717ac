"""Documents of GeoJSON by hand."""


def geometry(kind, coordinates):
    return {"type": kind, "coordinates": coordinates}


def feature(geometry, **properties):
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def collection(*features):
    return {"type": "FeatureCollection", "crs": None, "features": features}


def node(number, x=0.0, y=0.0, **more):
    """A node of a route graph."""
    return feature(geometry("Point", [x, y]), id=number, **more)


def edge(number, start, end, **more):
    """An edge of a route graph, whose line nobody reads."""
    return feature(geometry("MultiLineString", []), id=number, startid=start, endid=end, **more)
