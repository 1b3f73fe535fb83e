//! Where to look from: of several candidates the one that sees most.

use super::random::Random;
use super::stage::{Interest, Stage};
use super::xml::{Element, number, triple};
use crate::scene::{Camera, FovAxis, Perspective, Scene};
use glam::{DMat4, DVec3, Vec2};
use std::collections::BTreeMap;

/// A camera of a generated scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    origin: DVec3,
    target: DVec3,
    up: DVec3,
    fov_degrees: f64,
    /// Radius of the lens and the distance in focus.
    lens: Option<[f64; 2]>,
}

/// What the cameras of a scene look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Aim {
    /// One thing, filling the picture or half of it.
    Thing,
    /// Two things and what is between.
    Group,
    /// Whatever is around something, from anywhere.
    Surroundings,
}

/// Rays across and down that judge a candidate.
const PROBES: [u32; 2] = [20, 15];

impl View {
    /// Any view; [`View::candidate`] makes better ones.
    pub(super) fn any() -> Self {
        Self {
            origin: DVec3::new(0.0, 1.0, 5.0),
            target: DVec3::ZERO,
            up: DVec3::Y,
            fov_degrees: 45.0,
            lens: None,
        }
    }

    /// Looks at something of the stage, from inside its camera box.
    pub(super) fn candidate(stage: &Stage, aim: Aim, random: &mut Random) -> Self {
        let fov_degrees = random.uniform(20.0, 75.0);
        let pick = |random: &mut Random| match stage.interests.len() {
            0 => Interest { center: DVec3::Y, radius: 1.0 },
            count => stage.interests[random.integer(0, count - 1)],
        };
        let interest = match aim {
            Aim::Thing | Aim::Surroundings => pick(random),
            Aim::Group => {
                let [a, b] = [pick(random), pick(random)];
                let radius = 0.5 * a.center.distance(b.center) + a.radius.max(b.radius);
                Interest { center: 0.5 * (a.center + b.center), radius }
            }
        };
        let (low, high) = stage.camera_box;
        let origin = if aim == Aim::Surroundings {
            let reach = 6.0 * interest.radius.max(0.3) + stage.interests.len() as f64 * 0.3;
            let (near, far) = (interest.center - reach, interest.center + reach);
            random.point(low.max(near), high.min(far).max(low.max(near)))
        } else {
            let wanted = interest.radius.max(0.05) / (0.5 * fov_degrees.to_radians()).tan();
            let mut direction = random.direction();
            direction.y = random.uniform(-0.05, 0.75);
            interest.center + direction.normalize() * (wanted * random.log_uniform(1.2, 2.6))
        };
        let offset = random.direction() * (interest.radius * random.uniform(0.0, 0.5));
        let roll = if random.chance(0.12) { random.uniform(-0.3, 0.3) } else { 0.0 };
        let up = DVec3::new(roll, 1.0, 0.3 * roll);
        let target = interest.center + offset;
        Self { origin: origin.clamp(low, high), target, up, fov_degrees, lens: None }
    }

    /// With a lens that blurs what is out of focus; `share` is its radius in terms of the distance to the target.
    pub(super) fn defocused(mut self, share: f64) -> Self {
        let distance = self.origin.distance(self.target);
        self.lens = Some([share * distance, distance]);
        self
    }

    /// The camera in a loaded scene.
    pub(super) fn camera(&self, scene: &Scene, film: [u32; 2]) -> Option<Camera> {
        let forward = (self.target - self.origin).try_normalize()?;
        let left = self.up.cross(forward).try_normalize()?;
        let center = self.origin - scene.origin;
        let to_world = DMat4::from_cols(
            left.extend(0.0),
            forward.cross(left).extend(0.0),
            forward.extend(0.0),
            center.extend(1.0),
        );
        let [aperture_radius, focus_distance] = self.lens.unwrap_or([0.0, 1.0]);
        Camera::perspective(&Perspective {
            to_world,
            fov: self.fov_degrees,
            fov_axis: FovAxis::Larger,
            film,
            aperture_radius,
            focus_distance,
            ..Perspective::default()
        })
        .ok()
    }

    /// How much there is to see: the entropy (nats) of what rays meet, told apart by part, facing and distance. Less where
    /// much is too near, flies off into nothing, or is seen from behind, as from within a solid.
    pub(super) fn score(&self, scene: &Scene) -> f64 {
        let Some(camera) = self.camera(scene, PROBES) else { return f64::NEG_INFINITY };
        let reach = self.origin.distance(self.target);
        let mut seen: BTreeMap<(u32, [i8; 3], i32), u32> = BTreeMap::new();
        let (mut near, mut lost, mut inside) = (0.0, 0.0, 0.0);
        for (x, y) in (0..PROBES[0] * PROBES[1]).map(|i| (i % PROBES[0], i / PROBES[0])) {
            let raster = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let ray = camera.ray(raster, Vec2::splat(0.5));
            match scene.geometry.intersect(&ray) {
                None => lost += 1.0,
                Some(hit) => {
                    let at = scene.geometry.interaction(&ray, &hit);
                    if f64::from(hit.t) < 0.25 * reach {
                        near += 1.0;
                    }
                    if at.normal.dot(ray.direction) > 0.0 {
                        inside += 1.0;
                    }
                    let facing = at.shading_normal.to_array().map(|c| (c * 1.5).round() as i8);
                    let distance = (3.0 * f64::from(hit.t).ln()).floor() as i32;
                    *seen.entry((at.part, facing, distance)).or_default() += 1;
                }
            }
        }
        let total = f64::from(PROBES[0] * PROBES[1]);
        let entropy: f64 = seen
            .values()
            .map(|count| {
                let share = f64::from(*count) / total;
                -share * share.ln()
            })
            .sum();
        entropy - 4.0 * near / total - 2.0 * inside / total - 2.0 * (lost / total - 0.3).max(0.0)
    }

    /// The `<sensor>`.
    pub(super) fn element(&self, film: [u32; 2]) -> Element {
        let look_at = Element::new("lookat")
            .attribute("origin", triple(self.origin))
            .attribute("target", triple(self.target))
            .attribute("up", triple(self.up));
        let name = if self.lens.is_some() { "thinlens" } else { "perspective" };
        let mut sensor = Element::plugin("sensor", name)
            .float("fov", self.fov_degrees)
            .string("fov_axis", "larger")
            .child(Element::new("transform").attribute("name", "to_world").child(look_at));
        if let Some([radius, distance]) = self.lens {
            sensor = sensor.float("aperture_radius", radius).float("focus_distance", distance);
        }
        let [width, height] = film.map(|side| number(f64::from(side)));
        let film = Element::plugin("film", "hdrfilm")
            .value("integer", "width", width)
            .value("integer", "height", height)
            .child(Element::plugin("rfilter", "box"));
        let sampler = Element::plugin("sampler", "independent").integer("sample_count", 64);
        sensor.child(film).child(sampler)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::LoadOptions;

    #[test]
    fn the_camera_that_judges_is_the_one_in_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.xml");
        let view = View {
            origin: DVec3::new(3.0, 2.0, -1.0),
            target: DVec3::new(0.5, 0.2, 0.1),
            up: DVec3::new(0.2, 1.0, 0.1),
            ..View::any()
        }
        .defocused(0.03);
        let film = [64, 48];
        let ball = Element::plugin("shape", "sphere").point("center", DVec3::new(9.0, 0.0, 2.0));
        let scene = Element::new("scene").attribute("version", "3.0.0");
        std::fs::write(&path, scene.child(view.element(film)).child(ball).text()).unwrap();
        let scene = Scene::load(&path, &LoadOptions::default()).unwrap();
        let ours = view.camera(&scene, film).unwrap();
        for (raster, lens) in [([1.0, 2.0], [0.1, 0.9]), ([63.0, 40.0], [0.7, 0.3])] {
            let (raster, lens) = (Vec2::from(raster), Vec2::from(lens));
            let (a, b) = (ours.ray(raster, lens), scene.camera.ray(raster, lens));
            assert!((a.origin - b.origin).length() < 1e-4, "{} {}", a.origin, b.origin);
            assert!((a.direction - b.direction).length() < 1e-5, "{} {}", a.direction, b.direction);
        }
    }
}
