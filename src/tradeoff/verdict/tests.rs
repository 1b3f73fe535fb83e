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
    let mut curves: BTreeMap<Combination, Curve> = BTreeMap::new();
    for one in [PATH, ERPT] {
        let of = points.iter().filter(|point| point.combination == one);
        let place = |point: &Point| Place { seconds: point.seconds.mean, error: point.error.mean };
        curves.insert(one, Curve::new(of.map(place).collect(), 1e-9));
    }
    let reference = ReferenceScores {
        integrator: "path".into(),
        reason: "walks find it".into(),
        samples: [8, 8],
        seconds: 1.0,
        noise: 1e-9,
    };
    Verdict::of(&curves, &points, &auto, &reference)
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
