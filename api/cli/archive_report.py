"""The page of `archive solve --report`: change of normals relative to σ, and failures; it needs no network."""

import html
import json
from dataclasses import asdict
from datetime import UTC, datetime
from string import Template
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from acquisition.archive.distributed import SolveReport

_PAGE = Template("""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Archive solved again</title>
<style>
body { font: 16px system-ui; margin: 2rem; max-width: 60rem }
td, th { padding: .2rem 1rem; text-align: right }
</style>
<h1>Archive solved again</h1>
<p>$date UTC: $solved solved, $kept already solved, $failed failed.</p>
$failures
<h2>Changes relative to σ</h2>
<p>Mean angle between the normals and those of the previous result, and the rms of that angle over the earlier σ.
Both results use the same images, so the latter should be below 1.</p>
<table>
<tr><th>session</th><th>object</th><th>mean °</th><th>rms over σ</th></tr>
$rows
</table>
<script type="application/json">$json</script>
</html>
""")


def page(report: "SolveReport") -> str:
    """Returns the report of one call as HTML, with the same figures as JSON inside."""
    rows = [
        f"<tr><td><code>{item.session[:12]}</code></td><td>{html.escape(item.object)}</td>"
        f"<td>{item.mean_deg:.3f}</td><td>{item.over_sigma:.2f}</td></tr>"
        for item in report.moved
    ]
    failures = [f"<li><code>{key[:12]}</code> {html.escape(why)}</li>" for key, why in sorted(report.failures.items())]
    return _PAGE.substitute(
        date=f"{datetime.now(UTC):%Y-%m-%d %H:%M}",
        solved=report.solved,
        kept=report.kept,
        failed=report.failed,
        failures="\n".join(["<h2>Failed</h2><ul>", *failures, "</ul>"]) if failures else "",
        rows="\n".join(rows),
        json=json.dumps(asdict(report)).replace("<", "\\u003c"),
    )
