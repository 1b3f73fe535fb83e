use super::*;
use crate::tradeoff::curve::Place;
use crate::tradeoff::settings::Method;

const PATH: Combination = Combination { integrator: Method::Path, denoiser: Filter::None };
const ERPT: Combination = Combination { integrator: Method::Erpt, denoiser: Filter::None };

fn point(combination: Combination, seconds: f64, error: f64, spread: f64) -> Point {
    let sure = |mean| Estimate { mean, interval: Some([mean, mean]) };
    Point {
        combination,
        samples: 1,
        seeds: 3,
        render_seconds: sure(seconds),
        denoise_seconds: sure(0.0),
        seconds: sure(seconds),
        cpu_seconds: None,
        error: Estimate { mean: error, interval: Some([error - spread, error + spread]) },
        is_known: true,
        bias2: Some(0.0),
        variance: Some(error),
        one_minus_ssim: None,
        psnr: sure(30.0),
        flip: sure(0.1),
        invalid_samples: 0,
        picture: "x.exr".into(),
    }
}

/// Path tracing with error 1/t from a tenth of a second to ten, and energy redistribution with 0.5/t from one to ten.
fn verdict(auto: impl Fn(f64) -> Combination, spread: f64) -> Verdict {
    let mut points = Vec::new();
    for time in [0.1, 1.0, 10.0] {
        points.push(point(PATH, time, 1.0 / time, spread / time));
        if time >= 1.0 {
            points.push(point(ERPT, time, 0.5 / time, spread / time));
        }
    }
    verdict_of(&points, auto)
}

fn verdict_of(points: &[Point], auto: impl Fn(f64) -> Combination) -> Verdict {
    let mut places: BTreeMap<Combination, Vec<Place>> = BTreeMap::new();
    for point in points {
        let place = Place { seconds: point.seconds.mean, error: point.error.mean };
        places.entry(point.combination).or_default().push(place);
    }
    let curves = places.into_iter().map(|(one, all)| (one, Curve::new(all, 1e-9))).collect();
    let reference = ReferenceScores {
        integrator: "path".into(),
        reason: "walks find it".into(),
        samples: [8, 8],
        seconds: 1.0,
        noise: 1e-9,
    };
    Verdict::of(&curves, points, &auto, &reference)
}

#[test]
fn the_choice_changes_with_the_budget() {
    let verdict = verdict(|_| ERPT, 0.01);
    assert_eq!(
        verdict.headline,
        "Up to 0.5 s, take path, not denoised; beyond that, erpt, not denoised."
    );
    let budgets: Vec<f64> = verdict.choices.iter().map(|choice| choice.seconds).collect();
    assert_eq!(budgets, [0.1, 0.5, 1.0, 5.0, 10.0]);
    let last = verdict.choices.last().unwrap();
    assert!(last.is_clear && (last.error - 0.05).abs() < 1e-12, "{last:?}");
    let (rival, error) = last.rival.unwrap();
    assert!(rival == PATH && (error - 0.1).abs() < 1e-12, "{last:?}");
    assert_eq!(verdict.standing, Standing::Right);
    assert!(
        verdict.auto.ends_with(": right (as good as the best at 3 of 5 budgets)."),
        "{verdict:?}"
    );
}

#[test]
fn auto_is_wrong_where_the_seeds_tell_another_apart_and_only_there() {
    let clear = verdict(|_| PATH, 0.01);
    assert_eq!(clear.standing, Standing::Wrong);
    assert!(
        clear.auto.contains("after 10 s leaves 2.0 times as much as the best (0.1 against 5.0e-2"),
        "{}",
        clear.auto
    );
    // Intervals of 0.3/t around 1/t and 0.5/t overlap: they may be the same, and the one may be twice the other.
    let open = verdict(|_| PATH, 0.3);
    assert!(open.standing == Standing::Open && !open.choices[4].is_clear, "{open:?}");
}

#[test]
fn auto_may_change_with_the_budget() {
    let verdict = verdict(|seconds| if seconds < 0.7 { PATH } else { ERPT }, 0.01);
    let taken: Vec<Combination> = verdict.choices.iter().map(|choice| choice.auto).collect();
    assert_eq!(taken, [PATH, PATH, ERPT, ERPT, ERPT]);
    assert!(verdict.choices.iter().all(|choice| choice.standing == Standing::Right), "{verdict:?}");
    assert_eq!(
        verdict.auto,
        "“auto” takes path, not denoised up to 0.5 s and then erpt, not denoised, which is the best after 10 s: right \
         (as good as the best at 5 of 5 budgets)."
    );
}

#[test]
fn what_was_not_measured_is_not_judged() {
    let other_denoiser = Combination { denoiser: Filter::KpcnBalanced, ..PATH };
    let other_integrator = Combination { integrator: Method::Bdpt, ..PATH };
    for (auto, name) in
        [(other_denoiser, "path + kpcn-balanced"), (other_integrator, "bdpt, not denoised")]
    {
        let verdict = verdict(|_| auto, 0.01);
        assert_eq!(
            verdict.auto,
            format!(
                "“auto” takes {name}, which was not measured: nothing tells whether that is right."
            )
        );
        assert_eq!(verdict.standing, Standing::Open);
        assert_eq!(
            verdict.headline,
            "Up to 0.5 s, take path, not denoised; beyond that, erpt, not denoised."
        );
        let budgets: Vec<f64> = verdict.choices.iter().map(|choice| choice.seconds).collect();
        assert_eq!(budgets, [0.1, 0.5, 1.0, 5.0, 10.0]);
        for choice in &verdict.choices {
            assert!(choice.standing == Standing::Open && choice.take == choice.best, "{choice:?}");
        }
    }
}

#[test]
fn budgets_where_auto_was_not_measured_are_told_from_those_where_it_is_not_the_best() {
    let other = Combination { integrator: Method::Bdpt, ..PATH };
    // The best up to half a second, not measured beyond.
    let after = verdict(|seconds| if seconds < 0.7 { PATH } else { other }, 0.01);
    assert_eq!(
        after.auto,
        "“auto” takes path, not denoised up to 0.5 s and then bdpt, not denoised, which was not measured: nothing tells \
         whether that is right (as good as the best at 2 of 5 budgets, not measured at 3)."
    );
    let before = verdict(|seconds| if seconds < 0.7 { other } else { ERPT }, 0.01);
    assert_eq!(before.standing, Standing::Right);
    assert!(
        before
            .auto
            .ends_with(": right (as good as the best at 3 of 5 budgets, not measured at 2)."),
        "{}",
        before.auto
    );
}

#[test]
fn auto_is_wrong_where_its_measurements_begin_later() {
    let bilateral = Combination { denoiser: Filter::Bilateral, ..PATH };
    let mut points = vec![point(ERPT, 5.0, 0.1, 0.01), point(ERPT, 10.0, 0.05, 0.005)];
    for one in [PATH, bilateral] {
        points.extend([0.1, 1.0].map(|time| point(one, time, 1.0 / time, 0.01 / time)));
    }
    let verdict = verdict_of(&points, |_| ERPT);
    assert_eq!(verdict.standing, Standing::Wrong);
    assert!(
        verdict.auto.starts_with(
            "“auto” takes erpt, not denoised, which has no picture after 1 s: not the best choice here"
        ),
        "{}",
        verdict.auto
    );
}
