//! Rounds of correlated visibility sampling.

use super::RenderSettings;
use super::method::{Found, Method, Report};
use crate::film::SplatFilm;
use crate::integrator::CorrelatedVisibility;
use crate::integrator::correlated_visibility::{
    HalfFound, Ledger, PixelSums, Shard, VisibilityRendering,
};
use crate::scene::{FilmSettings, Scene};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A render by correlated visibility sampling under way: two halves, each with marks of its own, that take turns.
#[derive(Debug)]
pub(super) struct Visibility<'a> {
    film: FilmSettings,
    halves: [VisibilityRendering<'a>; 2],
    /// Camera rays that exchange energy at a time.
    hits: u32,
}

/// What the two halves found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Halves<'h> {
    film: FilmSettings,
    halves: [Cow<'h, HalfFound>; 2],
}

impl<'a> Visibility<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        method: CorrelatedVisibility,
        settings: &RenderSettings,
        found: Option<Halves<'static>>,
    ) -> Self {
        let shard = Shard { index: settings.shard.index(), count: settings.shard.count() };
        let half =
            |half| VisibilityRendering::new(scene, method, settings.seed, half).of_shard(shard);
        let halves = match found {
            Some(Halves { halves: [a, b], .. }) => {
                [half(0).with(a.into_owned()), half(1).with(b.into_owned())]
            }
            None => [half(0), half(1)],
        };
        Self { film: scene.film, halves, hits: method.hits.max(1) }
    }
}

impl Method for Visibility<'_> {
    fn round(&mut self, most: u32) {
        let wanted = [most.div_ceil(2), most / 2];
        for (half, wanted) in self.halves.iter_mut().zip(wanted) {
            half.advance(wanted.min(half.hits() + self.hits));
        }
    }

    fn is_complete(&self, most: u32) -> bool {
        self.halves.iter().map(VisibilityRendering::hits).sum::<u32>() >= most
    }

    fn found(&self) -> Found<'_> {
        let halves = self.halves.each_ref().map(|half| Cow::Borrowed(half.found()));
        Found::Visibility(Halves { film: self.film, halves })
    }
}

impl Halves<'_> {
    pub(super) fn samples(&self) -> u32 {
        self.halves.iter().map(|half| half.hits()).sum()
    }

    pub(super) fn done(&self) -> u64 {
        u64::from(self.samples()) * self.film.crop_pixels()
    }

    pub(super) fn film(&self) -> SplatFilm {
        let mut film = SplatFilm::of_independent(self.film);
        for (index, half) in self.halves.iter().enumerate() {
            let of_pixel =
                |sums: &PixelSums| ([sums.diffuse, sums.specular], sums.spread(half.hits()));
            film.add_sums(index, half.sums().iter().map(of_pixel));
        }
        film
    }

    pub(super) fn invalid(&self) -> u64 {
        self.halves.iter().map(|half| half.ledger().invalid).sum()
    }

    /// Adds what other rounds of the same picture found.
    pub(super) fn merge(&mut self, other: &Self) {
        for (half, more) in self.halves.iter_mut().zip(&other.halves) {
            half.to_mut().merge(more);
        }
    }

    pub(super) fn report(&self) -> Report {
        let sum = |number: fn(&Ledger) -> u64| {
            self.halves.iter().map(|half| number(half.ledger())).sum::<u64>().to_string()
        };
        let marked: usize =
            self.halves.iter().filter_map(|half| half.marks()).map(|marks| marks.len()).sum();
        let pixels = 2 * self.film.crop_pixels();
        let facts = [
            ("marked", format!("{:.4}", marked as f64 / pixels.max(1) as f64)),
            ("pilot_rays", sum(|ledger| ledger.pilot_rays)),
            ("shadow_rays", sum(|ledger| ledger.shadow_rays)),
            ("exchange_mutations", sum(|ledger| ledger.mutations)),
            ("exchange_chains", sum(|ledger| ledger.chains)),
        ];
        let facts = facts.map(|(name, value)| (name.to_owned(), value)).into();
        Report { facts, warnings: Vec::new() }
    }
}
