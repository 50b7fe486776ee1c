"""A figure of one's own: what rules use of the adhesion against how long their wheels slip."""

from paper_figs.drawing import comparison, figure
from paper_figs.style import COLUMN, new_panels


@figure("use-against-slip", "used adhesion against slip time, by rule", comparison)
def use_against_slip(rows):
    """One point per event. Events lie apart more than rules do."""
    drawn, axes = new_panels(COLUMN, 2.4)
    for rule, own in rows.groupby("rule", sort=False):
        axes.plot(own["slip_time"], own["bound_use"], ".", gid=rule, label=rule)
    axes.set_xlabel("Slip time [axle s]")
    axes.set_ylabel("Used of what rail and motors allow")
    axes.legend()
    return drawn
