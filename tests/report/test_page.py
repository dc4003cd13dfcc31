"""The page: self-contained, and it says what it has to say."""

import base64
import dataclasses
import html
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from report.fake import FORCE, diagnosis

from jaxmuscle.decimation import extremes
from jaxmuscle.diagnosis.diagnosis_data import Estimate, Pattern
from jaxmuscle.diagnosis.evidence import LIKELIHOOD_RATIO
from jaxmuscle.effects import ForceDrift, LoadFriction
from jaxmuscle.formatting import capital, words
from jaxmuscle.html_template import template
from jaxmuscle.report import tables
from jaxmuscle.report.doubts import doubts
from jaxmuscle.report.figures import correlation_figure
from jaxmuscle.report.page import page
from jaxmuscle.report.sentence import sentence

VERDICTS = ("effects found", "complete", "undecided", "not confirmed", "unexplained")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_page_is_one_file_with_the_sentence_first(verdict: str) -> None:
    outcome = diagnosis(verdict)
    text = page(outcome)
    assert f"<h1>{sentence(outcome)}</h1>" in html.unescape(text)
    assert text.index("<h1>") < text.index("<table>")
    addresses = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", text)
    assert addresses and all(address.startswith("data:image/svg+xml;base64,") for address in addresses)
    assert not re.search(r"<link|@import|url\(", text)
    # What runs is what comes with the package, and the page forbids itself to fetch anything.
    assert re.findall("<script[^>]*>", text) == [
        '<script type="application/json" id="traces">',
        "<script>",
        "<script>",
    ]
    assert "Content-Security-Policy\" content=\"default-src 'none';" in text
    assert len(text) < 3_000_000
    pictures = [base64.b64decode(a.partition(",")[2]).decode() for a in addresses]
    assert all(picture.rstrip().endswith("</svg>") for picture in pictures)
    # Inside a picture only its own parts are referred to, never a file.
    inner = [target for picture in pictures for target in re.findall(r'xlink:href="([^"]*)"', picture)]
    assert all(target.startswith(("#", "data:")) for target in inner)


@pytest.mark.parametrize(
    ("verdict", "told"),
    [
        (
            "effects found",
            "Every other candidate predicts unseen windows significantly worse than load friction",
        ),
        ("complete", "<h2>Nothing is missing</h2>"),
        ("unexplained", "No guess is made at what it is"),
        ("undecided", "<h2>Something may be missing</h2>"),
        ("not confirmed", "<h2>Held-out data do not confirm it</h2>"),
    ],
)
def test_page_says_what_the_verdict_means(verdict: str, told: str) -> None:
    assert told in page(diagnosis(verdict))


@pytest.mark.slow
def test_page_tells_candidates_that_were_not_tried_on_unseen_windows() -> None:
    outcome, told = (
        diagnosis("effects found"),
        "explains too little, or far less, of the windows that it was fitted to",
    )
    assert told not in page(outcome)
    first = outcome.rounds[0]
    untried = dataclasses.replace(first.ranking[-1], judged=False)
    search = dataclasses.replace(first, ranking=(*first.ranking[:-1], untried))
    text = page(dataclasses.replace(outcome, rounds=(search, *outcome.rounds[1:])))
    assert told in text
    assert "explains too little where it is fitted" in text


def test_page_tells_provenance() -> None:
    outcome = diagnosis("effects found")
    text = page(outcome)
    assert outcome.recording.sha256 is not None
    for told in (
        "lift.csv",
        outcome.recording.sha256,
        "6000 rows",
        "isotonic",
        "optimistix",
        "folds: 5",
        "31 s",
    ):
        assert told in text


def test_page_escapes_what_the_user_wrote() -> None:
    outcome = diagnosis("complete")
    card = dataclasses.replace(outcome.recording.card, description="<script>alert(1)</script>")
    recording = dataclasses.replace(outcome.recording, card=card)
    assert "alert(1)</script" not in page(dataclasses.replace(outcome, recording=recording))


def test_a_fit_that_did_not_converge_is_said() -> None:
    outcome = diagnosis("complete")
    warning = "take the values below as provisional"
    assert warning not in page(outcome)
    assert warning in page(dataclasses.replace(outcome, converged=False))


def test_page_without_horizon_rounds_reveal_or_file() -> None:
    outcome = diagnosis("complete")
    recording = dataclasses.replace(outcome.recording, file=None, sha256=None)
    traces = dataclasses.replace(outcome.traces, windows=np.array([0, 4200]))
    bare = dataclasses.replace(outcome, recording=recording, horizon=None, rounds=(), traces=traces)
    assert "predicting each part in one run" in page(bare)


def test_the_page_says_what_windows_begin_with() -> None:
    outcome = diagnosis("complete")
    card = dataclasses.replace(outcome.recording.card, state_from="past")
    past = dataclasses.replace(outcome, recording=dataclasses.replace(outcome.recording, card=card))
    assert "predicting 1 s ahead from each measured start" in page(outcome)
    assert "predicting 1 s ahead from what samples up to each start tell" in page(past)


def test_pages_of_one_diagnosis_are_equal() -> None:
    assert page(diagnosis("complete")) == page(diagnosis("complete"))


def test_thinning_keeps_peaks_and_gaps() -> None:
    values = np.zeros(10_000)
    values[1234], values[7777], values[5000] = 5.0, -3.0, np.nan
    rows = extremes(values, 200)
    assert len(rows) < 320
    assert {1234, 7777, 5000, 0, 9999} <= set(rows.tolist())


def test_doubts_stand_in_a_box_at_the_top() -> None:
    text = html.unescape(page(diagnosis("not confirmed")))
    box = text[text.index("<b>Doubts</b>") : text.index("<table>")]
    assert "End factor comes out 4.2 standard deviations from the card" in box
    assert "12 readings of position do not count" in box
    assert "Creep helped on unseen training windows and was taken out again" in box
    assert "<b>Doubts</b>" not in page(diagnosis("complete"))


def test_a_noise_that_hides_what_is_smaller_is_told() -> None:
    """The readings scatter by 0.03 mm."""
    found = diagnosis("complete")
    taken = lambda noise: dataclasses.replace(found, noise={**found.noise, "position": noise})  # noqa: E731
    assert doubts(taken(2e-4)) == []
    (told,) = doubts(taken(0.002))
    assert told.startswith("The noise of position is taken as 2.0 mm, but its readings scatter by 30 µm from")
    assert "errors below 2.0 mm is not looked for" in told
    columns = found.recording.columns
    coarse = dataclasses.replace(
        found.recording, columns={**columns, "position": columns["position"].round(2)}
    )
    assert "hardly scatter" in doubts(dataclasses.replace(taken(0.002), recording=coarse))[0]


def test_a_pattern_of_what_is_left_stands_beside_what_it_depends_on() -> None:
    found = diagnosis("unexplained")
    cogs = Pattern("ripple", "position", 0.01089, "m", 0.96)
    left = dataclasses.replace(found.unexplained[0], pattern=cogs)
    text = html.unescape(page(dataclasses.replace(found, unexplained=(left,))))
    said = "depends on <b>position and velocity</b>; 96\u00a0% of it repeats every 10.9 mm of the position."
    assert said in text


def test_a_candidate_that_could_not_be_tried_is_told() -> None:
    found = diagnosis("unexplained")
    *others, last = found.rounds[0].ranking
    failed = dataclasses.replace(last, judged=False, failed=True)
    search = dataclasses.replace(found.rounds[0], ranking=(*others, failed))
    broken = dataclasses.replace(found, rounds=(search, search))
    told = [each for each in doubts(broken) if "could not be tried" in each]
    assert told == [
        f"{capital(words(last.name))} could not be tried: with it the model's predictions are not numbers."
    ]
    assert tables.ranking(search)[-1]["outcome"] == "could not be tried"
    assert not any("could not be tried" in each for each in doubts(found))


def test_a_search_without_a_candidate_worth_judging_has_no_best_one() -> None:
    found = diagnosis("unexplained")
    first, *others = (dataclasses.replace(each, judged=False) for each in found.rounds[0].ranking)
    for ranking, told in (
        ((first, *others), f"none of {1 + len(others)} candidates helped enough to be added."),
        ((first,), "the only candidate did not help enough to be added."),
    ):
        search = dataclasses.replace(found.rounds[0], ranking=ranking, added=None)
        assert told in html.unescape(page(dataclasses.replace(found, rounds=(search,))))


def test_few_stretches_are_told() -> None:
    found = diagnosis("effects found")
    (first, *others), *rest = found.rounds[0].ranking, *found.rounds[1:]
    few = dataclasses.replace(first, test=LIKELIHOOD_RATIO, stretches=4)
    searches = (dataclasses.replace(found.rounds[0], ranking=(few, *others)), *rest)
    told = doubts(dataclasses.replace(found, rounds=searches))
    assert any("Only 4 stretches" in each and "below 0.06" in each for each in told)
    assert not any("stretches" in each for each in doubts(found))


def test_a_strength_that_is_known_together_with_its_shape_only_is_told() -> None:
    """Of a decay whose end is not seen."""
    found = diagnosis("effects found")
    own = {"share": Estimate(0.049, 0.027, "", ""), "time_constant": Estimate(24.7, 20.0, "s", "")}
    effect = dataclasses.replace(found.effects[0], name="force_drift", parameters=own)
    model = found.model.with_effects(force_drift=ForceDrift())
    paths = {f"effects.force_drift.{name}": e for name, e in own.items()}
    std = {path: e.std for path, e in paths.items()}
    given = lambda name, held: 0.0034 if held else std[name]  # noqa: E731
    fit: Any = SimpleNamespace(parameters=paths, std=std, std_given=given)
    drift = dataclasses.replace(found, effects=(effect,), model=model, fit=fit)
    (told,) = [each for each in doubts(drift) if "together" in each]
    assert told == (
        "The share of force drift is not determined by itself (0.05 ± 0.03), only together with its other "
        "parameters: were these known, it would be to 0.0034."
    )
    # That folds disagree is no reason, nor is it of an effect that has no shapes.
    std["effects.force_drift.share"] = 0.007
    assert not any("together" in each for each in doubts(drift))
    paths[FORCE] = Estimate(1.0, 0.8, "N", "")
    std[FORCE] = 0.7
    rubs = dataclasses.replace(found.effects[0], parameters={"force": paths[FORCE]})
    model = found.model.with_effects(load_friction=LoadFriction())
    friction = dataclasses.replace(found, effects=(rubs,), model=model, fit=fit)
    assert not any("together" in each for each in doubts(friction))


def test_symbols_have_subscripts() -> None:
    shown = template("page.html.j2", "jaxmuscle.report").environment.filters["subscripts"]
    assert shown("F_c < F_s, not load_friction") == "F<sub>c</sub> &lt; F<sub>s</sub>, not load_friction"


def test_correlations_leave_out_the_diagonal_and_signs_of_nothing() -> None:
    matrix = np.array([[1.0, -0.001, -0.5], [-0.001, 1.0, 0.004], [-0.5, 0.004, 1.0]])
    (axes,) = correlation_figure(pd.DataFrame(matrix, columns=list("abc"), index=list("abc"))).axes
    assert sorted({text.get_text() for text in axes.texts}) == ["0.00", "−0.50"]
    assert len(axes.texts) == 6
