//! Many walks at a time.

use super::walk::{Arrival, Rules, Walk};
use super::{PathSample, PathTracing};
use crate::geometry::Ray;
use crate::sampler::Sampler;
use crate::scene::Scene;

/// Walks that are taken together, one stage of all after the other.
///
/// A walk by itself is a long chain in which each step waits for the one before. The same stage of different walks does not
/// wait: the processor works on several at once, and finds code and branches of one kind.
pub struct Batch<'a, S> {
    rules: Rules<'a>,
    walks: Vec<Walk<'a, S>>,
    /// Walks that go on.
    active: Vec<usize>,
    /// Those of them that passed through a mask.
    passed: Vec<usize>,
}

impl<'a, S: Sampler> Batch<'a, S> {
    /// Without walks.
    pub fn new(settings: &PathTracing, scene: &'a Scene) -> Self {
        Self {
            rules: Rules::new(settings, scene),
            walks: Vec::new(),
            active: Vec::new(),
            passed: Vec::new(),
        }
    }

    /// One more walk, that begins with `ray`.
    pub fn push(&mut self, ray: Ray, sampler: S) {
        self.walks.push(Walk::new(&self.rules, ray, sampler));
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        self.walks.is_empty()
    }

    /// Takes all walks to their ends: what [`PathTracing::trace`] gives for each, in their order, bit by bit. Afterwards
    /// there are none.
    pub fn trace(&mut self) -> impl Iterator<Item = PathSample> {
        let Self { rules, walks, active, passed } = self;
        active.extend(0..walks.len());
        loop {
            active.retain(|&index| walks[index].may_go_on(rules));
            if active.is_empty() {
                break;
            }
            active.retain(|&index| {
                let is_hit = walks[index].intersect(rules);
                if !is_hit {
                    walks[index].escape(rules);
                }
                is_hit
            });
            active.iter().for_each(|&index| walks[index].interact(rules));
            active.retain(|&index| {
                let arrival = walks[index].arrive(rules);
                if arrival == Arrival::Passed {
                    passed.push(index);
                }
                arrival == Arrival::Surface && walks[index].may_go_on(rules)
            });
            active.iter().for_each(|&index| walks[index].light(rules));
            active.iter().for_each(|&index| walks[index].shadow(rules));
            active.retain(|&index| {
                walks[index].collect();
                walks[index].scatter(rules, false).is_continue()
            });
            active.append(passed);
        }
        walks.drain(..).map(|walk| walk.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::Strategy;
    use crate::sampler::SobolSampler;
    use crate::scene::{LoadOptions, Scene};
    use glam::Vec2;
    use std::path::Path;

    /// A mask before a floor, seen through a lens, under light from everywhere.
    const MASKED: &str = r#"<scene version="3.0.0">
        <sensor type="thinlens">
            <float name="aperture_radius" value="0.1"/> <float name="focus_distance" value="3"/>
            <film type="hdrfilm"><integer name="width" value="64"/> <integer name="height" value="48"/></film>
            <transform name="to_world"><lookat origin="0,0.5,-3" target="0,0,0" up="0,1,0"/></transform>
        </sensor>
        <shape type="rectangle">
            <transform name="to_world"><scale value="3"/> <rotate x="1" angle="-90"/> <translate y="-1"/></transform>
        </shape>
        <shape type="rectangle">
            <bsdf type="mask"> <float name="opacity" value="0.4"/> <bsdf type="diffuse"/> </bsdf>
        </shape>
        <emitter type="constant"/>
    </scene>"#;

    #[test]
    fn walks_find_the_same_together_as_alone() {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
        let folder = tempfile::tempdir().unwrap();
        let masked = folder.path().join("masked.xml");
        std::fs::write(&masked, MASKED).unwrap();
        let ours = ["cornell-box", "mis-plates", "still-life", "caustic-pool"];
        for path in ours.map(|name| scenes.join(name)).into_iter().chain([masked]) {
            let scene = Scene::load(&path, &LoadOptions::default()).unwrap();
            let size = Vec2::new(scene.film.width as f32, scene.film.height as f32);
            for strategy in [Strategy::Mis, Strategy::Features] {
                for max_depth in [0, 2, u32::MAX] {
                    let settings = PathTracing { strategy, max_depth };
                    let start = |sample| {
                        let mut sampler = SobolSampler::new(1, 0, sample);
                        let raster = sampler.next_2d() * size;
                        (scene.camera.ray(raster, sampler.next_2d()), sampler)
                    };
                    let mut batch = Batch::new(&settings, &scene);
                    (0..200).map(start).for_each(|(ray, sampler)| batch.push(ray, sampler));
                    for (sample, together) in (0..).zip(batch.trace()) {
                        let (ray, mut sampler) = start(sample);
                        let alone = settings.trace(&scene, ray, &mut sampler);
                        assert_eq!(together, alone, "{path:?} {settings:?} {sample}");
                    }
                    assert!(batch.is_empty());
                }
            }
        }
    }
}
