//! Two models side by side.

use super::{Bsdf, BsdfEval, BsdfSample, DeltaEval, DeltaLobe};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// A mixture of two models, which may themselves be mixtures.
#[derive(Clone, Debug)]
pub struct Blend<'a> {
    /// Part of the second model, in `[0, 1]`.
    weight: f32,
    models: Box<[Bsdf<'a>; 2]>,
}

impl<'a> Blend<'a> {
    /// The first model where `weight` is 0, the second where it is 1; the weight is limited to that range.
    pub(super) fn build(weight: f32, first: Bsdf<'a>, second: Bsdf<'a>) -> Bsdf<'a> {
        let weight = weight.clamp(0.0, 1.0);
        // The pure ends need no mixture, and no memory.
        if weight == 0.0 {
            first
        } else if weight == 1.0 {
            second
        } else {
            Bsdf::Blend(Self { weight, models: Box::new([first, second]) })
        }
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let [first, second] = self.models.each_ref().map(|model| model.eval(wo, wi));
        let t = self.weight;
        BsdfEval {
            diffuse: first.diffuse.lerp(second.diffuse, t),
            specular: first.specular.lerp(second.specular, t),
            pdf: first.pdf * (1.0 - t) + second.pdf * t,
        }
    }

    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        // The models are chosen with their weights; what is left of `lobe` is uniform again.
        let first = 1.0 - self.weight;
        let is_first = lobe < first;
        let (model, probability, lobe) = if is_first {
            (&self.models[0], first, lobe / first)
        } else {
            (&self.models[1], self.weight, (lobe - first) / self.weight)
        };
        let sample = model.sample(wo, lobe.min(1.0 - f32::EPSILON / 2.0), u)?;
        if let Some(delta) = sample.delta {
            let leaf = if is_first {
                delta.leaf
            } else {
                self.models[0].leaves().saturating_add(delta.leaf)
            };
            let delta = Some(DeltaLobe { leaf, ..delta });
            // Weight and probability of the model cancel in the weight of the sample.
            return Some(BsdfSample { pdf: sample.pdf * probability, delta, ..sample });
        }
        self.eval(wo, sample.wi).sampled(sample.wi, sample.eta)
    }

    pub(super) fn delta(&self, wo: Vec3, lobe: DeltaLobe) -> Option<DeltaEval> {
        let (model, share, leaf) = match lobe.leaf.checked_sub(self.models[0].leaves()) {
            None => (&self.models[0], 1.0 - self.weight, lobe.leaf),
            Some(leaf) => (&self.models[1], self.weight, leaf),
        };
        let part = model.delta(wo, DeltaLobe { leaf, ..lobe })?;
        DeltaEval::new(part.wi, part.reflectance * share, part.probability * share, part.eta)
    }

    pub(super) fn leaves(&self) -> u8 {
        let [first, second] = self.models.each_ref().map(Bsdf::leaves);
        first.saturating_add(second)
    }

    pub(super) fn has_smooth(&self) -> bool {
        self.models.iter().any(Bsdf::has_smooth)
    }

    pub(super) fn albedo(&self) -> Rgb {
        self.models[0].albedo().lerp(self.models[1].albedo(), self.weight)
    }
}
