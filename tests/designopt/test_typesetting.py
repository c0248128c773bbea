"""What people read: subscripts, code, units; and what is left as it stands."""

import pytest

from designopt.plot.figures import new_figure
from designopt.plot.typesetting import as_html, as_mathtext, heading


@pytest.mark.parametrize(
    ("text", "page"),
    [
        ("μ_C and μ_G' fall.", "μ<sub>C</sub> and μ<sub>G'</sub> fall."),
        ("|Δl_D| inside Δl_A.", "|Δl<sub>D</sub>| inside Δl<sub>A</sub>."),
        ("T_a = k γ_p at θ_CD", "T<sub>a</sub> = k γ<sub>p</sub> at θ<sub>CD</sub>"),
        ("`specs/a_b.toml`, k_s", "<code>specs/a_b.toml</code>, k<sub>s</sub>"),
        ("`<a_b>` & <i>", "<code>&lt;a_b&gt;</code> &amp; &lt;i&gt;"),
        ("spring_stiffness, a_b.toml, x_1/2, b.a_c", "spring_stiffness, a_b.toml, x_1/2, b.a_c"),
        ("one ` alone", "one ` alone"),
    ],
)
def test_plain_text_as_html(text, page):
    assert as_html(text) == page


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("x_mm", "x (mm)"),
        ("worst_px_per_mm", "worst (px/mm)"),
        ("rate_px_per_deg", "rate (px/°)"),
        ("motor_n_mm", "motor (N mm)"),
        ("covariance_h_mm2", "covariance h (mm²)"),
        ("paper_percent", "paper (%)"),
        ("paper_delta_l_d_cm", "paper Δl_D (cm)"),
        ("theta_cd_deg", "θ_CD (°)"),
        ("eta_from_theta", "η from θ"),
        ("covariance_delta_mm2", "covariance δ (mm²)"),
        ("μ_G'_deg", "μ_G' (°)"),
        ("stop_pip_n_mm", "stop PIP (N mm)"),
        ("met", "met"),
        ("seconds_low", "seconds low"),
        ("theatre_mm", "theatre (mm)"),
        ("limits.crank_length", "`limits.crank_length`"),
    ],
)
def test_the_head_of_a_column(column, words):
    assert heading(column) == words


def test_a_subscript_is_drawn_below_the_line():
    """Smaller than the letters beside each other would be, and without the underscore."""
    drawing, axes = new_figure()
    widths = []
    for text in (as_mathtext("μ_C"), "μ_C", as_mathtext("5 $ and μ")):
        shown = axes[0, 0].text(0, 0, text)
        drawing.draw_without_rendering()
        widths.append(shown.get_window_extent().width)
    assert widths[0] < widths[1]
    assert as_mathtext("5 $ and μ") == r"5 \$ and μ"
