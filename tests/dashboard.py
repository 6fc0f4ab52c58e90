"""Runs every query of a Grafana dashboard on a Prometheus: each must be understood and find something.

    dashboard.py DASHBOARD.json http://HOST:PORT

Waits up to a minute, since rates need two scrapes.
"""

import json
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

path, url = sys.argv[1:]
with open(path) as file:
    panels = json.load(file)["panels"]
queries = [(p["title"], t["expr"]) for p in panels for t in p["targets"]]
assert len(queries) >= len(panels) > 0, "a dashboard without queries"


def answer(expression):
    """What Prometheus finds: a list of series, or a sentence on why it can't."""
    try:
        with urllib.request.urlopen(f"{url}/api/v1/query?" + urllib.parse.urlencode({"query": expression}), timeout=5) as r:
            return json.load(r)["data"]["result"]
    except urllib.error.HTTPError as error:
        return json.load(error)["error"]
    except OSError as error:
        return str(error)


deadline = time.monotonic() + 60
left = queries
while left:
    found = [(title, expression, answer(expression)) for title, expression in left]
    left = [(title, expression) for title, expression, got in found if not isinstance(got, list) or not got]
    if left and time.monotonic() > deadline:
        for title, expression, got in found:
            if (title, expression) in left:
                print(f"{title}: {expression}: {got or 'no series'}", file=sys.stderr)
        sys.exit(1)
    if left:
        time.sleep(2)
print(f"   {len(queries)} queries of {len(panels)} panels find their series")
