//! Rounds of correlated visibility sampling.

use super::RenderSettings;
use super::method::{Method, Report};
use crate::film::{Radiance, Scale, SplatFilm};
use crate::integrator::CorrelatedVisibility;
use crate::integrator::correlated_visibility::VisibilityRendering;
use crate::scene::Scene;
use quietlight_denoise::Layers;

/// A render by correlated visibility sampling under way: two halves, each with marks of its own, that take turns.
#[derive(Debug)]
pub(super) struct Visibility<'a> {
    scene: &'a Scene,
    halves: [VisibilityRendering<'a>; 2],
    /// Camera rays that exchange energy at a time.
    hits: u32,
}

impl<'a> Visibility<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        method: CorrelatedVisibility,
        settings: &RenderSettings,
    ) -> Self {
        let half = |half| VisibilityRendering::new(scene, method, settings.seed, half);
        Self { scene, halves: [half(0), half(1)], hits: method.hits.max(1) }
    }
}

impl Method for Visibility<'_> {
    fn round(&mut self, most: u32) {
        let wanted = [most.div_ceil(2), most / 2];
        for (half, wanted) in self.halves.iter_mut().zip(wanted) {
            half.advance(wanted.min(half.hits() + self.hits));
        }
    }

    fn samples(&self) -> u32 {
        self.halves.iter().map(VisibilityRendering::hits).sum()
    }

    fn done(&self) -> u64 {
        u64::from(self.samples()) * self.scene.film.crop_pixels()
    }

    fn put_radiance(&self, layers: &mut Layers) {
        let mut film = SplatFilm::new(self.scene.film);
        for (index, half) in self.halves.iter().enumerate() {
            film.add_sums(index, half.sums().iter().map(|sums| [sums.diffuse, sums.specular]));
        }
        film.put_into(layers, &Scale::of_samples(self.samples()), Radiance::Replaced);
    }

    fn invalid(&self) -> u64 {
        self.halves.iter().map(|half| half.ledger().invalid).sum()
    }

    fn report(&self) -> Report {
        let sum = |number: fn(&VisibilityRendering<'_>) -> u64| {
            self.halves.iter().map(number).sum::<u64>().to_string()
        };
        let marked: usize =
            self.halves.iter().filter_map(|half| half.marks()).map(|marks| marks.len()).sum();
        let pixels = 2 * self.scene.film.crop_pixels();
        let facts = [
            ("marked", format!("{:.4}", marked as f64 / pixels.max(1) as f64)),
            ("pilot_rays", sum(|half| half.ledger().pilot_rays)),
            ("shadow_rays", sum(|half| half.ledger().shadow_rays)),
            ("exchange_mutations", sum(|half| half.ledger().mutations)),
            ("exchange_chains", sum(|half| half.ledger().chains)),
        ];
        let facts = facts.map(|(name, value)| (name.to_owned(), value)).into();
        Report { facts, warnings: Vec::new() }
    }
}
