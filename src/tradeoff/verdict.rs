//! What to choose on a scene, and why, in words with the numbers that decide it.

use super::curve::{Curve, Level, Reach};
use super::scores::{Combination, Point, ReferenceScores};
use super::settings::Filter;
use super::statistics::Estimate;
use super::words::{decimal, factor, relative_l2, seconds};
use serde::Serialize;
use std::collections::BTreeMap;

/// Errors that differ by less than this factor are the same to a person who chooses.
const SAME: f64 = 1.1;

/// Errors that differ by more than this factor and are not told apart by the seeds ask for more seeds, not for either choice.
const OPEN: f64 = 1.5;

/// Budgets of time that choices are told for, at most.
const BUDGETS: usize = 5;

/// What to choose.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Verdict {
    /// In one sentence.
    pub headline: String,
    /// For several budgets of time, rising.
    pub choices: Vec<Choice>,
    /// Why, sentence by sentence.
    pub reasons: Vec<String>,
    /// What `auto` takes, and whether that is right.
    pub auto: String,
    /// Is what `auto` takes as good as the best, at the longest budget?
    pub standing: Standing,
}

/// How what `auto` takes compares with the best.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// As good as the best, or not told apart from it and not far off.
    Right,
    /// The seeds tell that it is worse.
    Wrong,
    /// It seems worse, but the seeds do not tell; or it was not measured.
    #[default]
    Open,
}

impl Standing {
    /// Its name in files and in the page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Wrong => "wrong",
            Self::Open => "open",
        }
    }
}

/// The best for a budget of time.
#[derive(Clone, Debug, Serialize)]
pub struct Choice {
    /// Wall time of render and denoiser, in seconds.
    pub seconds: f64,
    /// What leaves the least error.
    pub best: Combination,
    /// The error that it leaves, relative L2.
    pub error: f64,
    /// The next best, and the error that it leaves.
    pub rival: Option<(Combination, f64)>,
    /// Is the best told apart from the next best by the seeds, and by more than a tenth?
    pub is_clear: bool,
    /// What `auto` takes.
    pub auto: Combination,
    /// The error that it leaves; `None` where it has no picture yet, or was not measured.
    pub auto_error: Option<f64>,
    /// How that compares.
    pub standing: Standing,
    /// What to take: what `auto` takes where that is right, else the best.
    pub take: Combination,
}

struct Judge<'a> {
    curves: &'a BTreeMap<Combination, Curve>,
    points: &'a [Point],
    /// What `auto` takes for so many seconds.
    auto: &'a dyn Fn(f64) -> Combination,
}

impl Verdict {
    /// Judges the curves of a scene; `auto` tells what `auto` takes for so many seconds.
    pub(super) fn of(
        curves: &BTreeMap<Combination, Curve>,
        points: &[Point],
        auto: &dyn Fn(f64) -> Combination,
        reference: &ReferenceScores,
    ) -> Self {
        let judge = Judge { curves, points, auto };
        let choices: Vec<Choice> =
            budgets(curves, auto).into_iter().filter_map(|seconds| judge.choose(seconds)).collect();
        let Some(last) = choices.last() else { return Self::default() };
        Self {
            headline: headline(&choices),
            reasons: judge.reasons(last, reference),
            auto: judge.of_auto(&choices, last),
            standing: last.standing,
            choices,
        }
    }
}

/// Round times, 1, 2 and 5 times powers of ten, from the first picture to where half of the curves have ended, or that of `auto`
/// has: with more samples it might have been better.
fn budgets(curves: &BTreeMap<Combination, Curve>, auto: &dyn Fn(f64) -> Combination) -> Vec<f64> {
    let ranges: Vec<[f64; 2]> = curves.values().filter_map(Curve::range).collect();
    let mut ends: Vec<f64> = ranges.iter().map(|range| range[1]).collect();
    ends.sort_by(f64::total_cmp);
    let Some(&end) = ends.get(ends.len() / 2) else { return Vec::new() };
    let end_of_auto = |seconds: f64| Some(curves.get(&auto(seconds)).and_then(Curve::range)?[1]);
    let end = end_of_auto(end).map_or(end, |of_auto| end.min(of_auto));
    let start = ranges.iter().fold(f64::INFINITY, |least, range| least.min(range[0]));
    let all: Vec<f64> = (-4..=6)
        .flat_map(|power| [1, 2, 5].map(|one| decimal(one, power)))
        .filter(|&seconds| end_of_auto(seconds).is_none_or(|of_auto| seconds <= of_auto))
        .filter(|seconds| (start..=end).contains(seconds))
        .collect();
    match all.len() {
        0 => vec![end],
        // Evenly spread, the longest always among them.
        count if count > BUDGETS => {
            let step = (count - 1) as f64 / (BUDGETS - 1) as f64;
            (0..BUDGETS).map(|index| all[(index as f64 * step).round() as usize]).collect()
        }
        _ => all,
    }
}

fn headline(choices: &[Choice]) -> String {
    let mut pieces: Vec<(Combination, f64)> = Vec::new();
    for choice in choices {
        match pieces.last_mut() {
            Some((take, until)) if *take == choice.take => *until = choice.seconds,
            _ => pieces.push((choice.take, choice.seconds)),
        }
    }
    let last = pieces.len() - 1;
    let told: Vec<String> = pieces
        .iter()
        .enumerate()
        .map(|(index, (take, until))| match index {
            _ if last == 0 => format!("Take {take}"),
            0 => format!("Up to {}, take {take}", seconds(*until)),
            _ if index == last => format!("beyond that, {take}"),
            _ => format!("up to {}, {take}", seconds(*until)),
        })
        .collect();
    format!("{}.", told.join("; "))
}

impl Judge<'_> {
    fn choose(&self, seconds: f64) -> Option<Choice> {
        let mut ranked: Vec<(Combination, f64)> = self
            .curves
            .iter()
            .filter_map(|(&combination, curve)| Some((combination, curve.at(seconds)?.error())))
            .collect();
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        let &(best, error) = ranked.first()?;
        let rival = ranked.get(1).copied();
        let is_clear = rival.is_some_and(|(rival, other)| {
            other >= SAME * error && self.is_apart(best, rival, seconds)
        });
        let auto = (self.auto)(seconds);
        let auto_error = ranked.iter().find(|(one, _)| *one == auto).map(|&(_, error)| error);
        let standing = match auto_error {
            Some(of_auto) if of_auto < SAME * error => Standing::Right,
            Some(of_auto) if self.is_apart(best, auto, seconds) || of_auto.is_nan() => {
                Standing::Wrong
            }
            Some(of_auto) if of_auto < OPEN * error => Standing::Right,
            Some(_) => Standing::Open,
            None if self.is_measured(auto) => Standing::Wrong,
            None => Standing::Open,
        };
        let take = if standing == Standing::Right { auto } else { best };
        Some(Choice { seconds, best, error, rival, is_clear, auto, auto_error, standing, take })
    }

    /// What `auto` takes, and whether that is right.
    fn of_auto(&self, choices: &[Choice], last: &Choice) -> String {
        let (auto, time) = (last.auto, seconds(last.seconds));
        let is_measured = self.is_measured(auto);
        let errors = |error: f64| {
            format!("({} against {} by {})", relative_l2(error), relative_l2(last.error), last.best)
        };
        let facts = match last.auto_error {
            None if !is_measured => "which was not measured".to_owned(),
            None => format!("which has no picture after {time}"),
            Some(_) if last.best == auto => format!("which is the best after {time}"),
            Some(error) if last.standing == Standing::Right => {
                format!("which is as good as the best after {time} {}", errors(error))
            }
            Some(error) => format!(
                "which after {time} leaves {} times as much as the best {}",
                factor(error / last.error),
                errors(error)
            ),
        };
        let verdict = match last.standing {
            Standing::Right => "right",
            Standing::Wrong => "not the best choice here",
            Standing::Open if !is_measured => "nothing tells whether that is right",
            Standing::Open => "perhaps not the best choice: it takes more seeds to tell",
        };
        let good = choices.iter().filter(|choice| choice.take == choice.auto).count();
        let unmeasured = choices.iter().filter(|choice| !self.is_measured(choice.auto)).count();
        let all = match choices.len() {
            1 => String::new(),
            count if unmeasured == count => String::new(),
            count => {
                let but = match unmeasured {
                    0 => String::new(),
                    some => format!(", not measured at {some}"),
                };
                format!(" (as good as the best at {good} of {count} budgets{but})")
            }
        };
        let before = match choices.iter().rev().find(|choice| choice.auto != auto) {
            Some(other) => format!("{} up to {} and then ", other.auto, seconds(other.seconds)),
            None => String::new(),
        };
        format!("“auto” takes {before}{auto}, {facts}: {verdict}{all}.")
    }

    /// Was a combination measured at all?
    fn is_measured(&self, combination: Combination) -> bool {
        self.curves.contains_key(&combination)
    }

    /// Do the seeds tell the errors of two combinations apart at a time? By the last measurements until then.
    fn is_apart(&self, first: Combination, second: Combination, seconds: f64) -> bool {
        let [a, b] = [first, second].map(|one| self.point_at(one, seconds).map(|it| &it.error));
        matches!((a, b), (Some(a), Some(b)) if Estimate::is_apart_from(a, b))
    }

    /// The last measurement of a combination until a time.
    fn point_at(&self, combination: Combination, seconds: f64) -> Option<&Point> {
        let until =
            |point: &&Point| point.combination == combination && point.seconds.mean <= seconds;
        self.points.iter().filter(until).max_by(|a, b| a.seconds.mean.total_cmp(&b.seconds.mean))
    }

    fn reasons(&self, last: &Choice, reference: &ReferenceScores) -> Vec<String> {
        let mut reasons = vec![self.by_integrator(last)];
        reasons.extend(self.denoising(last));
        reasons.extend(self.bias(last));
        reasons.push(format!(
            "What the light asks for, by a few pairs of walks: {}.",
            reference.reason
        ));
        let below = self.points.iter().filter(|point| !point.is_known).count();
        if below > 0 {
            reasons.push(format!(
                "{below} of {} measurements are below the noise of the reference, {}, and count as that: a longer \
                 reference would tell them apart.",
                self.points.len(),
                relative_l2(reference.noise)
            ));
        }
        reasons
    }

    /// The best of each integrator.
    fn by_integrator(&self, last: &Choice) -> String {
        let mut best: BTreeMap<_, (f64, Combination, bool)> = BTreeMap::new();
        for (&combination, curve) in self.curves {
            let Some(level) = curve.at(last.seconds) else { continue };
            let entry = (level.error(), combination, matches!(level, Level::Ended(_)));
            let slot = best.entry(combination.integrator).or_insert(entry);
            if entry.0 < slot.0 {
                *slot = entry;
            }
        }
        let mut ranked: Vec<_> = best.into_values().collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let told: Vec<String> = ranked
            .iter()
            .map(|(error, combination, has_ended)| {
                let mark = if *has_ended { " (its measurements end before)" } else { "" };
                format!("{combination} {}{mark}", relative_l2(*error))
            })
            .collect();
        format!(
            "After {}, each integrator with its best denoiser leaves, as relative L2: {}.",
            seconds(last.seconds),
            told.join("; ")
        )
    }

    /// What the denoiser is worth.
    fn denoising(&self, last: &Choice) -> Option<String> {
        let noisy: Vec<(Combination, &Curve)> = self
            .curves
            .iter()
            .filter(|(combination, _)| combination.denoiser == Filter::None)
            .map(|(&combination, curve)| (combination, curve))
            .collect();
        let error = |curve: &Curve| curve.at(last.seconds).map_or(f64::INFINITY, Level::error);
        let (combination, curve) =
            noisy.iter().min_by(|a, b| error(a.1).total_cmp(&error(b.1))).copied()?;
        let left = error(curve);
        if !left.is_finite() {
            return None;
        }
        if last.best.denoiser == Filter::None {
            return Some(format!(
                "No denoiser pays after {}: what is not denoised has the least error.",
                seconds(last.seconds)
            ));
        }
        let reached = noisy.iter().filter_map(|(one, curve)| match curve.reach(last.error)? {
            Reach::After(at) | Reach::Within(at) => Some((at, *one)),
            Reach::Not(_) => None,
        });
        let time = match reached.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((at, one)) => format!("the same error takes {} by {one}", seconds(at)),
            None => "no measurement reaches the same error".to_owned(),
        };
        Some(format!(
            "Without a denoiser, {} leaves at best {}, {} times as much ({combination}), and {time}.",
            seconds(last.seconds),
            relative_l2(left),
            factor(left / last.error)
        ))
    }

    /// How much of the best's error more seeds would not average out.
    fn bias(&self, last: &Choice) -> Option<String> {
        let point = self.point_at(last.best, last.seconds)?;
        let (bias2, variance) = (point.bias2?, point.variance?);
        let part = bias2.max(0.0) / (bias2.max(0.0) + variance);
        if !part.is_finite() {
            return None;
        }
        let what = match part {
            part if part > 0.5 => "most is bias: averaging renders would not take it away",
            part if part > 0.1 => "the rest differs from seed to seed",
            _ => "nearly all of it is noise",
        };
        Some(format!(
            "Of the error of {} at {} samples, {:.0} % is bias; {what}.",
            last.best,
            point.samples,
            100.0 * part
        ))
    }
}

#[cfg(test)]
mod tests;
