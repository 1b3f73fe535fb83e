//! Who runs where: passes over tiles, rounds of chains, threads, budgets of samples or time, progress.

mod adaptive;
mod average;
mod bidirectional;
mod chains;
mod memory;
mod method;
mod plan;
pub mod probe;
mod redistribution;
mod sampled;
mod shard;
mod spread;
mod state;
mod strategies;
pub mod survey;
mod target;
mod units;
mod visibility;

pub use average::{Average, AverageError};
pub use memory::{NotEnoughMemory, check_memory};
pub use method::Report;
pub use plan::Plan;
pub use sampled::replay;
pub use shard::Shard;
pub use state::{Header, State, StateError};
pub use strategies::{StrategyImage, strategies, strategy_images};
pub use target::{Ending, Target};

use crate::integrator::Integrator;
use crate::scene::Scene;
use adaptive::{Rest, Spread};
use method::Method;
use quietlight_denoise::{Image, Layers};
use sampled::{Sampled, next_pass};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Where random numbers come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SamplerKind {
    /// Owen-scrambled Sobol points: lower error at the same count.
    #[default]
    Sobol,
    /// Independent numbers.
    Independent,
}

/// How much work a picture is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Budget {
    /// Samples per pixel: paths or mutations. Only these give the same bits again.
    Samples(u32),
    /// Wall time, heeded to within a pass or half a round.
    Time(Duration),
}

impl fmt::Display for Budget {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Samples(samples) => write!(out, "{samples} samples per pixel"),
            Self::Time(time) => write!(out, "{} s", time.as_secs_f64()),
        }
    }
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// When to stop.
    pub budget: Budget,
    /// The same seed gives the same bits, at any number of threads.
    pub seed: u64,
    /// Where random numbers of paths from the camera come from.
    pub sampler: SamplerKind,
    /// How light is found.
    pub integrator: Integrator,
    /// Which part of the picture's samples or chains to take. A part has no picture of its own: [`State::merged`] makes it
    /// out of all of them, bit by bit as if there had been only one. Only for budgets of samples.
    pub shard: Shard,
    /// Path tracing that ends after a quarter of its budget, a pilot; when it is told where the picture needs them
    /// ([`Rendering::spread`]), it takes the other samples there.
    pub is_adaptive: bool,
    /// Length of a pass: how often progress is whole and a stop is heeded.
    pub pass: Duration,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            budget: Budget::Samples(64),
            seed: 0,
            sampler: SamplerKind::default(),
            integrator: Integrator::default(),
            shard: Shard::WHOLE,
            is_adaptive: false,
            pass: Duration::from_secs(1),
        }
    }
}

/// Samples per pixel that path tracing takes for the feature layers of another method: their noise is that of what the
/// surface looks like, far below that of its light.
const FEATURE_SAMPLES: u32 = 16;

/// The part of a budget of time that the feature layers may take, once they have two samples per pixel, one a half.
const FEATURE_SHARE: u32 = 8;

/// A picture with its layers, and what it took.
#[derive(Debug)]
pub struct Rendered {
    /// All layers; the halves have corrected the variances of means of stratified samples, and given those of chains.
    pub layers: Layers,
    /// Samples or mutations per pixel taken; fewer than asked for when stopped.
    pub samples: u32,
    /// Non-finite samples and splats dropped.
    pub invalid_samples: u64,
    /// Wall time.
    pub elapsed: Duration,
    /// What the method found about itself.
    pub report: Report,
}

/// Renders `scene` on the threads of the current rayon pool.
///
/// `progress` is called, also from the workers, with the number of samples or mutations done so far, of the whole picture.
/// When `stop` becomes true the pass or round under way is finished and what there is comes back.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    progress: &(dyn Fn(u64) + Sync),
    stop: &AtomicBool,
) -> Rendered {
    let mut rendering = Rendering::new(scene, settings);
    rendering.run(settings.budget, progress, stop);
    rendering.finish()
}

/// A render that can go on: samples are taken in their order, so that how many at a time does not change the picture of
/// path tracing, nor that of other methods while they go on towards the samples that [`RenderSettings::budget`] names.
#[derive(Debug)]
pub struct Rendering<'a> {
    scene: &'a Scene,
    settings: RenderSettings,
    sampled: Sampled<'a>,
    /// What gives the radiance, from its first round on; never for path tracing.
    method: Option<Box<dyn Method + 'a>>,
    elapsed: Duration,
    /// Once it was asked for.
    plan: OnceLock<Plan>,
}

impl<'a> Rendering<'a> {
    /// A render without samples. `settings.budget` is not yet used up, but tells methods what to prepare for.
    pub fn new(scene: &'a Scene, settings: &RenderSettings) -> Self {
        let sampled = Sampled::new(scene, settings);
        Self {
            scene,
            settings: *settings,
            sampled,
            method: None,
            elapsed: Duration::ZERO,
            plan: OnceLock::new(),
        }
    }

    /// Samples or mutations per pixel taken so far.
    pub fn samples(&self) -> u32 {
        match &self.method {
            Some(method) => method.found().samples(),
            None if self.settings.integrator.is_path() => self.sampled.samples(),
            None => 0,
        }
    }

    /// Goes on until there are `samples` per pixel, on the threads of the current rayon pool; `progress` and `stop` are as
    /// for [`render`].
    pub fn advance(&mut self, samples: u32, progress: &(dyn Fn(u64) + Sync), stop: &AtomicBool) {
        self.run(Budget::Samples(samples), progress, stop);
    }

    /// Goes on until there are so many samples per pixel, or this wall time is used up, that of earlier runs included.
    pub fn run(&mut self, budget: Budget, progress: &(dyn Fn(u64) + Sync), stop: &AtomicBool) {
        let clock = Clock { before: self.elapsed, start: Instant::now() };
        if self.is_pilot() {
            self.sample(adaptive::pilot(budget), &clock, progress, stop);
        } else if self.method.is_some() && self.settings.integrator.is_path() {
            self.go_rounds(budget, &clock, progress, stop);
        } else if self.settings.integrator.is_path() {
            self.sample(budget, &clock, progress, stop);
        } else {
            let features = match budget {
                Budget::Samples(samples) => Budget::Samples(samples.min(FEATURE_SAMPLES)),
                Budget::Time(time) => Budget::Time(time / FEATURE_SHARE),
            };
            self.sample(features, &clock, &|_| {}, stop);
            self.go_rounds(budget, &clock, progress, stop);
        }
        self.elapsed = clock.elapsed();
    }

    /// Is it the pilot of adaptive path tracing, which [`Rendering::run`] does not go beyond?
    pub fn is_pilot(&self) -> bool {
        self.settings.is_adaptive && self.settings.integrator.is_path() && self.method.is_none()
    }

    /// Spreads the samples that the budget leaves after the pilot, by its `error`, `[1, height, width]`, or evenly where that
    /// is not known; [`Rendering::run`] takes them. Without effect where it is no pilot or nothing is left.
    ///
    /// # Panics
    /// If the error has not the size of the picture.
    pub fn spread(&mut self, error: Option<&Image>) {
        let pilot = self.samples();
        let seconds_each = self.elapsed.as_secs_f64() / f64::from(pilot.max(1));
        let left = match self.settings.budget {
            Budget::Samples(samples) => samples.saturating_sub(pilot),
            // More than there will be time for; the clock ends it.
            Budget::Time(time) => {
                let left = time.saturating_sub(self.elapsed).as_secs_f64();
                (1.5 * left / seconds_each.max(1e-9)) as u32
            }
        };
        if !self.is_pilot() || left < 2 {
            return;
        }
        let seconds = f64::from(left) * seconds_each;
        let spread = Spread::new(self.scene, pilot, left, error, seconds);
        self.method = Some(Box::new(Rest::new(self.scene, &self.settings, spread, None)));
    }

    /// Passes of path tracing. For another method's features, no more than these take.
    fn sample(
        &mut self,
        budget: Budget,
        clock: &Clock,
        progress: &(dyn Fn(u64) + Sync),
        stop: &AtomicBool,
    ) {
        let is_path = self.settings.integrator.is_path();
        let (fewest, most) = match budget {
            Budget::Samples(samples) => {
                let own = self.settings.shard.share(samples);
                (own, own)
            }
            Budget::Time(_) if is_path => (1, u32::MAX),
            Budget::Time(_) => (2, FEATURE_SAMPLES),
        };
        while self.sampled.samples() < most {
            let (samples, elapsed) = (self.sampled.samples(), clock.elapsed());
            let mut length = self.settings.pass;
            if let Budget::Time(time) = budget {
                let left = time.saturating_sub(elapsed);
                if left.is_zero() && samples >= fewest {
                    break;
                }
                length = length.min(left);
            }
            self.sampled.pass(next_pass(samples, most - samples, length, elapsed), progress);
            if stop.load(Ordering::Relaxed) {
                break;
            }
        }
    }

    /// Rounds of a method that is not path tracing.
    fn go_rounds(
        &mut self,
        budget: Budget,
        clock: &Clock,
        progress: &(dyn Fn(u64) + Sync),
        stop: &AtomicBool,
    ) {
        if self.method.is_none() {
            self.method = method::start(self.scene, &self.settings, None);
        }
        let Some(method) = &mut self.method else { return };
        let most = match budget {
            Budget::Samples(samples) => samples,
            Budget::Time(_) => u32::MAX,
        };
        while !method.is_complete(most) && !stop.load(Ordering::Relaxed) {
            let round = Instant::now();
            method.round(most);
            progress(method.found().done());
            // A round more would end later than now is early.
            let next = clock.elapsed() + round.elapsed() / 2;
            if matches!(budget, Budget::Time(time) if next >= time) {
                break;
            }
        }
    }

    /// Non-finite samples and splats dropped so far.
    pub fn invalid_samples(&self) -> u64 {
        let found = self.method.as_ref().map(|method| method.found());
        state::invalid(self.sampled.taken(), found.as_ref())
    }

    /// The layers as the samples so far give them, with corrected variances.
    pub fn layers(&self) -> Layers {
        let found = self.method.as_ref().map(|method| method.found());
        state::layers(
            self.sampled.taken(),
            found.as_ref(),
            self.settings.sampler,
            self.scene.origin,
        )
    }

    /// All that it needs to go on another time.
    pub fn state(&self) -> State<'_> {
        let is_complete = match self.settings.budget {
            Budget::Time(time) => self.elapsed >= time,
            Budget::Samples(samples) => match &self.method {
                Some(method) => method.is_complete(samples),
                None if self.settings.integrator.is_path() => {
                    self.sampled.samples() >= self.settings.shard.share(samples)
                }
                None => false,
            },
        };
        let header = Header {
            plan: self.plan.get_or_init(|| Plan::of(self.scene, &self.settings)).clone(),
            budget: self.settings.budget,
            shard: self.settings.shard,
            is_complete,
            elapsed: self.elapsed,
            notes: BTreeMap::new(),
        };
        State {
            header,
            taken: Cow::Borrowed(self.sampled.taken()),
            found: self.method.as_ref().map(|method| method.found()),
        }
    }

    /// Goes on from the state of a render with the same settings.
    ///
    /// # Errors
    /// [`StateError::Differs`] where it is of another scene, or of other settings that its numbers depend on.
    pub fn resume(
        scene: &'a Scene,
        settings: &RenderSettings,
        state: State<'static>,
    ) -> Result<Self, StateError> {
        state.header.check(scene, settings)?;
        let State { header: Header { plan, elapsed, .. }, taken, found } = state;
        let sampled = Sampled::new(scene, settings).with(taken.into_owned());
        let method = found.and_then(|found| method::start(scene, settings, Some(found)));
        let plan = OnceLock::from(plan);
        Ok(Self { scene, settings: *settings, sampled, method, elapsed, plan })
    }

    /// The picture.
    pub fn finish(self) -> Rendered {
        let start = Instant::now();
        let found = self.method.as_ref().map(|method| method.found());
        Rendered {
            layers: self.layers(),
            samples: self.samples(),
            invalid_samples: self.invalid_samples(),
            report: found.map_or_else(Report::default, |found| found.report()),
            elapsed: self.elapsed + start.elapsed(),
        }
    }
}

/// Wall time, that of earlier runs included.
struct Clock {
    before: Duration,
    start: Instant,
}

impl Clock {
    fn elapsed(&self) -> Duration {
        self.before + self.start.elapsed()
    }
}
