//! The bidirectional mutation (Veach and Guibas 1997, section 5.3.1; METHODS 5.4).
//!
//! A path is extended by an imaginary vertex at either end: `L*` before the light, from which the first vertex is sampled,
//! and `E*` behind the lens. Of its edges a few neighbours are removed and others put in, in a number that makes the new path
//! about as long as the old; which ones is the identity of the mutation, undone by one other alone. The new vertices are found
//! by walks from both sides of the gap, in a split that is *not* remembered, so that the density is a sum over all splits.

use super::super::{Failure, Proposal, TwoTailed};
use super::MutationSettings;
use super::trace::{hit, in_picture, is_connection, light, seen_by_lens};
use crate::geometry::Ray;
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::transport::path::between;
use crate::transport::walk::Leaving;
use crate::transport::{Event, LightVertex, Path, Side, Vertex};
use glam::{Vec2, Vec3};
use std::ops::RangeInclusive;

/// A piece of an extended path, and how long a piece takes its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cut {
    /// Extended index of the last vertex kept on the light's side; 0 is `L*`.
    left: usize,
    /// Edges that go.
    removed: usize,
    /// Edges that come.
    added: usize,
}

impl Cut {
    /// The cut that undoes this one.
    fn reverse(self) -> Self {
        Self { removed: self.added, added: self.removed, ..self }
    }

    /// How many of the new vertices walks from the light may find. The lens is never walked into.
    fn splits(self, extended: usize, has_visible: bool) -> RangeInclusive<usize> {
        let low = usize::from(self.left == 0 && !has_visible);
        let is_lens_new = self.left + self.removed == extended;
        low..=self.added - 1 - usize::from(is_lens_new)
    }
}

/// How many edges an extended path of `old` edges may become.
fn lengths(settings: &MutationSettings, old: usize) -> TwoTailed {
    TwoTailed::new(old as u32, settings.min_edges + 2, settings.max_edges + 2)
}

/// How many of its edges may go, if `new` are to be left.
fn removals(old: usize, new: usize) -> TwoTailed {
    let least = if new == old { 2 } else { 1 };
    TwoTailed::new(2, (old + 1).saturating_sub(new).max(least) as u32, old as u32)
}

/// Where a piece may be cut out: extended indices of the last vertex before it. Both vertices beside the gap must be able to
/// scatter smoothly; the edges to the imaginary ends are not replaced alone.
fn places(open: &[bool], removed: usize, added: usize) -> impl Iterator<Item = usize> {
    let margin = usize::from(removed == 1 || added == 1);
    let last = (open.len() - 1 - removed).checked_sub(margin);
    (margin..last.map_or(margin, |last| last + 1))
        .filter(move |&left| open[left] && open[left + removed])
}

/// Which vertices of the extended path are not purely of delta lobes.
fn open(path: &Path<'_>) -> Vec<bool> {
    let inner = path.vertices().iter().map(|vertex| match vertex {
        Vertex::Surface(surface) => surface.shading.bsdf.has_smooth(),
        Vertex::Light(_) | Vertex::Lens { .. } => true,
    });
    std::iter::once(true).chain(inner).chain([true]).collect()
}

/// One side of the gap, growing into it.
struct End<'s> {
    /// Vertices in the order of the walk.
    vertices: Vec<Vertex<'s>>,
    events: Vec<Event>,
    /// Unit vector from the last vertex to the one before it.
    back: Vec3,
    /// Was the raster position chosen here?
    has_raster: bool,
}

impl<'s> End<'s> {
    /// All before extended index `left + 1`.
    fn of_light(path: &Path<'s>, left: usize) -> Self {
        Self {
            vertices: path.vertices()[..left].to_vec(),
            events: path.events()[..left].to_vec(),
            back: if left >= 2 { -path.direction(left - 2) } else { Vec3::ZERO },
            has_raster: false,
        }
    }

    /// All from extended index `right` on.
    fn of_eye(path: &Path<'s>, right: usize) -> Self {
        let kept = right - 1..;
        let vertices = path.vertices().get(kept.clone()).unwrap_or_default();
        let events = path.events().get(kept).unwrap_or_default();
        Self {
            vertices: vertices.iter().rev().cloned().collect(),
            events: events.iter().rev().copied().collect(),
            back: if vertices.len() >= 2 { path.direction(right - 1) } else { Vec3::ZERO },
            has_raster: vertices.len() >= 2,
        }
    }

    fn push(&mut self, vertex: Vertex<'s>, back: Vec3) {
        self.vertices.push(vertex);
        self.events.push(Event::Smooth);
        self.back = back;
    }

    /// Finds the next vertex; of the eye's walk the last may have to be where the light begins.
    fn grow<S: Sampler>(
        &mut self,
        scene: &'s Scene,
        side: Side,
        is_light_expected: bool,
        sampler: &mut S,
    ) -> Result<(), Failure> {
        let ray = match (self.vertices.last_mut(), side) {
            (None, Side::Light) => {
                let (selection, u) = (sampler.next_1d(), sampler.next_2d());
                let (id, point, _) =
                    scene.emitters.sample_point(selection, u).ok_or(Failure::Dark)?;
                self.push(Vertex::Light(LightVertex { id, point }), Vec3::ZERO);
                return Ok(());
            }
            (None, Side::Eye) => {
                let lens = sampler.next_2d();
                let position = scene.camera.lens_point(lens);
                self.push(Vertex::Lens { raster: Vec2::ZERO, lens, position }, Vec3::ZERO);
                return Ok(());
            }
            (Some(Vertex::Light(LightVertex { id, point })), _) => {
                let emission = scene.emitters.sample_emission(*id, point, sampler.next_2d());
                emission.ok_or(Failure::Dark)?.0
            }
            (Some(Vertex::Lens { raster, lens, .. }), _) => {
                let [left, top, columns, rows] = scene.film.crop.map(|pixels| pixels as f32);
                let u = sampler.next_2d();
                *raster = in_picture(scene, Vec2::new(left, top) + u * Vec2::new(columns, rows))?;
                self.has_raster = true;
                scene.camera.ray(*raster, *lens)
            }
            (Some(Vertex::Surface(surface)), _) => {
                let (u, u_lobe) = (sampler.next_2d(), sampler.next_1d());
                let leaving = Leaving::choose(surface, side, self.back, u_lobe, u);
                let leaving = leaving.ok_or(Failure::Dark)?;
                let ray: Ray = surface.at.spawn(leaving.direction);
                if let Some(event) = self.events.last_mut() {
                    *event = leaving.event;
                }
                ray
            }
        };
        let vertex = if is_light_expected {
            light(scene, ray, sampler)?
        } else {
            Vertex::Surface(hit(scene, ray, sampler)?)
        };
        self.push(vertex, -ray.direction);
        Ok(())
    }

    /// Makes the last event smooth: it is connected.
    fn close(&mut self) {
        if let Some(event) = self.events.last_mut() {
            *event = Event::Smooth;
        }
    }
}

pub(super) fn propose<'s, S: Sampler>(
    scene: &'s Scene,
    settings: &MutationSettings,
    path: &Path<'s>,
    sampler: &mut S,
) -> Result<Proposal<Path<'s>>, Failure> {
    let old = path.k() + 2;
    let new = lengths(settings, old).sample(f64::from(sampler.next_1d())) as usize;
    let removed = removals(old, new).sample(f64::from(sampler.next_1d())) as usize;
    let added = new + removed - old;
    let open = open(path);
    let count = places(&open, removed, added).count();
    let left = places(&open, removed, added).nth(choose(sampler.next_1d(), count));
    let cut = Cut { left: left.ok_or(Failure::Impossible)?, removed, added };
    let state = replace(scene, path, cut, sampler)?;
    Ok(Proposal {
        forward: ln_c(scene, settings, path, &state, cut),
        backward: ln_c(scene, settings, &state, path, cut.reverse()),
        state,
    })
}

/// The path with another piece in the gap of the cut.
fn replace<'s, S: Sampler>(
    scene: &'s Scene,
    path: &Path<'s>,
    cut: Cut,
    sampler: &mut S,
) -> Result<Path<'s>, Failure> {
    let Cut { left, removed, added } = cut;
    let splits = cut.splits(path.k() + 2, scene.emitters.has_visible());
    let split = splits.start() + choose(sampler.next_1d(), splits.clone().count());
    let from_eye = if splits.contains(&split) {
        added - 1 - split
    } else {
        return Err(Failure::Impossible);
    };
    let mut light = End::of_light(path, left);
    let mut eye = End::of_eye(path, left + removed);
    for _ in 0..split {
        light.grow(scene, Side::Light, false, sampler)?;
    }
    let is_hit = left == 0 && split == 0;
    for step in 0..from_eye {
        eye.grow(scene, Side::Eye, is_hit && step + 1 == from_eye, sampler)?;
    }
    let state = join(scene, light, eye, is_hit)?;
    // What the camera sees directly may be left out of the picture.
    if state.k() == 1 && scene.limits.hide_emitters {
        return Err(Failure::Dark);
    }
    if !ln_split(scene, &state, cut, split).is_finite() {
        return Err(Failure::Blocked);
    }
    if !is_hit {
        let edge = left + split - 1;
        let vertices = state.vertices();
        if !(between(scene, &vertices[edge], &vertices[edge + 1]) > 0.0) {
            return Err(Failure::Blocked);
        }
    }
    Ok(state)
}

/// One of `count` by `u` in `[0, 1)`.
fn choose(u: f32, count: usize) -> usize {
    ((f64::from(u) * count as f64) as usize).min(count.saturating_sub(1))
}

/// The path of both ends.
fn join<'s>(
    scene: &'s Scene,
    mut light: End<'s>,
    mut eye: End<'s>,
    is_hit: bool,
) -> Result<Path<'s>, Failure> {
    if !is_hit {
        light.close();
        eye.close();
        if let (Some(Vertex::Surface(surface)), Some(Vertex::Lens { lens, .. })) =
            (light.vertices.last(), eye.vertices.last())
        {
            let end = seen_by_lens(scene, surface, *lens)?;
            eye.vertices = vec![end];
            eye.has_raster = true;
        }
    }
    if !eye.has_raster {
        // An emitter connected with the lens: what is seen directly is left to walks from the eye.
        return Err(Failure::Impossible);
    }
    light.vertices.extend(eye.vertices.into_iter().rev());
    light.events.extend(eye.events.into_iter().rev());
    Path::new(scene, light.vertices, light.events).ok_or(Failure::Dark)
}

/// `ln C(from → to)` by a cut that leads there: infinite where it never does.
fn ln_c(
    scene: &Scene,
    settings: &MutationSettings,
    from: &Path<'_>,
    to: &Path<'_>,
    cut: Cut,
) -> f64 {
    let (old, new) = (from.k() + 2, to.k() + 2);
    let splits = cut.splits(old, scene.emitters.has_visible());
    let choices = places(&open(from), cut.removed, cut.added).count() * splits.clone().count();
    let probability = lengths(settings, old).pmf(new as u32)
        * removals(old, new).pmf(cut.removed as u32)
        / choices as f64;
    let logarithms: Vec<f64> = splits
        .map(|split| -ln_split(scene, to, cut, split))
        .filter(|logarithm| logarithm.is_finite())
        .collect();
    let largest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return f64::INFINITY;
    }
    let sum: f64 = logarithms.iter().map(|logarithm| (logarithm - largest).exp()).sum();
    -(probability.ln() + largest + sum.ln())
}

/// `ln (f / p)` of a path whose new vertices were found in that split, but for the factors of kept edges: infinite where they
/// cannot be.
fn ln_split(scene: &Scene, to: &Path<'_>, cut: Cut, split: usize) -> f64 {
    let (first, last) = (cut.left, cut.left + cut.added - 1);
    let middle = first + split;
    let connection = match middle.checked_sub(1) {
        None if to.is_emitter_hittable() => 0.0,
        Some(edge) if is_connection(scene, to, edge) => to.ln_connection(edge),
        _ => return f64::INFINITY,
    };
    let light: f64 = (first..middle).map(|i| to.ln_found_from_light(i)).sum();
    let eye: f64 = (middle..last).map(|i| to.ln_found_from_eye(i)).sum();
    to.ln_value() + light + connection + eye
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::IndependentSampler;
    use crate::scene::LoadOptions;

    /// A ball of which the wall reflects 0.6 and shines with radiance 0.5, seen from its centre: paths of `k` edges bring
    /// `0.5 · 0.6^(k-1)`.
    const BALL: &str = r#"<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="5"/></integrator>
        <sensor type="perspective"><float name="fov" value="60"/>
            <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
                <rfilter type="box"/></film></sensor>
        <shape type="sphere"><boolean name="flip_normals" value="true"/>
            <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf>
            <emitter type="area"><rgb name="radiance" value="0.5"/></emitter></shape></scene>"#;

    #[test]
    fn replacing_a_whole_path_measures_the_light_of_each_length() {
        // The mean of C = f / T is the integral of f over all that the cut leads to.
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("ball.xml");
        std::fs::write(&file, BALL).unwrap();
        let scene = Scene::load(&file, &LoadOptions::default()).unwrap();
        let settings = MutationSettings::of(&scene);
        let mut sampler = IndependentSampler::new(1, 2, 3);
        let empty =
            || End { vertices: vec![], events: vec![], back: Vec3::ZERO, has_raster: false };
        let mut eye = empty();
        for step in 0..3 {
            eye.grow(&scene, Side::Eye, step == 2, &mut sampler).unwrap();
        }
        let mut path = join(&scene, empty(), eye, true).unwrap();
        for k in [1, 4, 2, 3, 5, 1] {
            let (old, new) = (path.k() + 2, k + 2);
            let cut = Cut { left: 0, removed: old, added: new };
            let chosen = lengths(&settings, old).pmf(new as u32)
                * removals(old, new).pmf(cut.removed as u32);
            let (count, mut sum, mut squares) = (20_000.0f64, 0.0, 0.0);
            let mut last = None;
            for _ in 0..count as u32 {
                if let Ok(state) = replace(&scene, &path, cut, &mut sampler) {
                    let value = chosen * ln_c(&scene, &settings, &path, &state, cut).exp();
                    sum += value;
                    squares += value * value;
                    last = Some(state);
                }
            }
            let (mean, expected) = (sum / count, 0.5 * 0.6f64.powi(k as i32 - 1));
            let error = ((squares / count - mean * mean) / count).sqrt();
            // Six means: 4.4 is the normal quantile of level 1e-4 over all of them.
            assert!(error < 0.02 * expected, "{old} to {new}: ± {error}");
            assert!(
                (mean - expected).abs() < 4.4 * error,
                "{old} to {new}: {mean} ± {error}, expected {expected}"
            );
            path = last.unwrap();
        }
    }

    #[test]
    fn places_are_those_of_the_worked_example() {
        // METHODS N.6: L D S D E, where S is the extended vertex 3.
        let open = [true, true, true, false, true, true, true];
        assert_eq!(places(&open, 2, 2).collect::<Vec<_>>(), [0, 2, 4]);
        assert_eq!(places(&open, 1, 2).collect::<Vec<_>>(), [1, 4]);
        // The whole path, and as little as can be.
        assert_eq!(places(&open, 6, 3).collect::<Vec<_>>(), [0]);
        assert_eq!(places(&open, 6, 1).count(), 0);
    }

    #[test]
    fn lengths_are_those_of_the_worked_example() {
        // METHODS N.5: around 4 in 3..=7.
        let lengths = TwoTailed::new(4, 3, 7);
        assert!((lengths.pmf(3) - 0.5 / 2.375).abs() < 1e-12);
        assert!((lengths.pmf(4) - 1.0 / 2.375).abs() < 1e-12);
    }

    #[test]
    fn every_cut_can_be_undone() {
        for old in 3..12 {
            for new in 3..12 {
                for removed in 1..=old {
                    let is_possible = removals(old, new).pmf(removed as u32) > 0.0;
                    let added = (new + removed).checked_sub(old);
                    if let Some(added) = added.filter(|&added| is_possible && added > 0) {
                        assert!(removals(new, old).pmf(added as u32) > 0.0);
                        let [there, back] = [
                            places(&vec![true; old + 1], removed, added).count(),
                            places(&vec![true; new + 1], added, removed).count(),
                        ];
                        assert_eq!(there, back, "{old} {new} {removed}");
                    } else {
                        assert!(!is_possible, "{old} {new} {removed}");
                    }
                }
            }
        }
    }
}
