"""The classifier and its margin: exact properties, trends and bands on SYN-1 (03 sections 5 to 7)."""

from itertools import pairwise

import numpy as np
import pytest

from rtctl.guidance import evaluation, folding, synthetic
from rtctl.guidance.dataset import CLASSES, FOLD, NORMAL, Dataset, synthesise
from rtctl.guidance.features import FEATURE_SAMPLES, GRID, SAMPLES, sampled
from rtctl.guidance.force_model import AOS_START, REFERENCE
from rtctl.guidance.training import train

SETS = 10
MARGINS = (0.0, 0.25, 0.5, 0.75, 1.0)


def test_h_is_the_sum_over_the_support_vectors(detector):
    """w is sum alpha_i y_i phi_i: what the file keeps decides as (VI.21) does."""
    data = synthesise(0, 51, 56)
    features = sampled(data.profiles, 3)
    phi = detector.folding.standard.apply(features)
    labels = np.repeat([1.0, -1.0], [51, 56])
    matrix = folding.linear_kernel(phi, phi)
    dual = folding.solve(matrix, labels, folding.LIMITS[2])
    wanted = np.array([sum(dual.multipliers * labels * (phi @ p)) + dual.bias for p in phi])
    assert detector.folding.decide(data.profiles) == pytest.approx(wanted, abs=1e-9)


def test_prediction_changes_h_by_no_more_than_the_bound_on_the_training_set(detector):
    data = synthesise(0, 51, 56)
    early = detector.folding.decide_early(REFERENCE, data.profiles)
    change = early - detector.folding.decide(data.profiles)[:, None]
    rms = np.sqrt((change**2).mean(axis=0))
    assert (rms <= detector.folding.bound * (1.0 + 1e-9)).all()
    assert rms.max() > 0.0


def test_the_bound_is_the_one_of_standardised_coordinates(detector):
    """About 22 early in the insertion, where the printed one would be about 1200."""
    assert 10.0 < detector.folding.bound[0] < 40.0
    data = synthesise(0, 51, 56)
    error = sampled(folding.completed(REFERENCE, data.profiles, 8), 3) - sampled(data.profiles, 3)
    later = np.tile(FEATURE_SAMPLES, 3) >= 8
    slope = detector.folding.weight / detector.folding.standard.deviation
    printed = np.linalg.norm(slope[later]) * np.sqrt((error**2).sum(axis=1).mean())
    assert printed > 6.0 * detector.folding.bound[0]


def test_a_larger_margin_flags_fewer_insertions_and_later(detector):
    early = detector.folding.decide_early(REFERENCE, synthesise(5, 80, 80).profiles)
    found = [detector.folding.detected(early, margin) for margin in MARGINS]
    for smaller, larger in pairwise(found):
        assert (larger[smaller < 0] < 0).all()
        both = larger > 0
        assert (larger[both] >= smaller[both]).all()


def test_known_samples_keep_their_measured_values():
    profiles = synthetic.normal(3, np.random.default_rng(1))
    done = folding.completed(REFERENCE, profiles, 40)
    assert (done[..., :40] == profiles[..., :40]).all()
    assert (done[..., 40:] != profiles[..., 40:]).all()
    assert folding.completed(REFERENCE, profiles, SAMPLES) == pytest.approx(profiles)


@pytest.fixture(scope="module")
def judged():
    """Evaluations by margin of detectors from ten training sets, each on 600 new insertions."""
    margins = 0.0, 0.25, 0.75
    results = {margin: [] for margin in margins}
    for seed in range(SETS):
        detector = train(synthesise(seed, 51, 56), reference_forces=True)
        fresh = synthesise(1000 + seed, 300, 300)
        for found in evaluation.evaluate(detector, fresh, margins):
            results[found.margin].append(found)
    return results


def mean(results, name):
    return float(np.mean([getattr(r, name) for r in results]))


def test_combined_accuracy_is_in_the_band_of_the_specification(judged):
    assert mean(judged[0.75], "accuracy") == pytest.approx(0.91, abs=0.03)


def test_the_margin_trades_false_positives_for_late_flags_as_the_specification_says(judged):
    positives = [mean(judged[m], "false_positives") for m in (0.0, 0.25, 0.75)]
    assert positives[1] < 0.8 * positives[0]
    assert positives[2] <= positives[1]
    negatives = [mean(judged[m], "false_negatives") for m in (0.0, 0.25, 0.75)]
    assert negatives[0] <= negatives[1] <= negatives[2] < negatives[0] + 0.03
    onsets = [mean(judged[m], "median_onset_mm") for m in (0.0, 0.25, 0.75)]
    assert onsets[0] < onsets[1] < onsets[2]


def test_nothing_is_flagged_before_the_stylet_is_held_back_with_half_the_margin_or_more(judged):
    assert mean(judged[0.0], "early_share") > 0.0
    assert mean(judged[0.75], "early_share") == 0.0
    assert min(min(r.onset_mm) for r in judged[0.75]) / 13.8 > AOS_START


@pytest.fixture(scope="module")
def accuracies():
    """Mean accuracy over 20 splits of ten data sets, by method."""
    sets = [synthesise(seed, 51, 56) for seed in range(SETS)]
    return {m: np.array([evaluation.cross_validate(d, m, 20, 0).mean() for d in sets]) for m in (1, 2, 3, 4)}


def test_method_2_is_in_the_band_of_the_specification(accuracies):
    assert accuracies[2].mean() == pytest.approx(0.90, abs=0.03)


def test_method_1_is_not_far_from_it(accuracies):
    assert accuracies[1].mean() == pytest.approx(accuracies[2].mean(), abs=0.03)


def test_the_rbf_methods_do_better_than_guessing(accuracies):
    assert accuracies[3].mean() > 0.65
    assert accuracies[4].mean() > 0.65


def test_smaller_folds_are_harder_to_see():
    def accuracy(share, seed):
        random = np.random.default_rng(seed)
        amplitude = (share * synthetic.FOLD[0], share * synthetic.FOLD[1])
        profiles = np.concatenate([synthetic.normal(51, random), synthetic.folding(56, random, amplitude=amplitude)])
        classes = np.repeat(np.array(CLASSES[:2]), (51, 56))
        return evaluation.cross_validate(Dataset(profiles, classes, "made up"), 2, 20, 0).mean()

    half, whole = (np.mean([accuracy(share, seed) for seed in range(6)]) for share in (0.5, 1.0))
    assert half < whole - 0.08


def test_an_evaluation_adds_up():
    detector, data = train(synthesise(3, 51, 56), reference_forces=True), synthesise(4, 30, 20, 10)
    (found,) = evaluation.evaluate(detector, data, [0.75])
    assert {name: row["insertions"] for name, row in found.confusion.items()} == data.counts()
    wrong = found.confusion[NORMAL]["fold"] + 20 - found.confusion[FOLD]["fold"]
    assert found.accuracy == pytest.approx(1.0 - wrong / 50)
    assert len(found.onset_mm) == found.confusion[FOLD]["fold"]
    assert all(0.0 < d <= 13.8 for d in found.onset_mm)
    assert GRID[-1] == 1.0
