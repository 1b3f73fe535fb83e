//! Cameras around what a given camera looks at.

use crate::dataset::seed::Dice;
use crate::geometry::Ray;
use crate::scene::{Camera, Perspective, Scene};
use glam::{DMat3, DMat4, DQuat, DVec3, Vec2};

/// How many places are tried.
const TRIES: usize = 100;

/// Rays across and down the film by which a place is judged.
const GRID: u32 = 8;

/// What the camera of the file looks at.
struct Subject {
    /// A point in front of the camera, on a surface if there is one.
    target: DVec3,
    /// The normal of the surface there, towards the camera of the file.
    normal: Option<DVec3>,
    /// From the camera of the file.
    distance: f64,
    /// Part of the film that shows surfaces.
    coverage: f64,
}

/// A camera that turns around the middle of what the file's camera sees, nearer or farther, with another field of view and
/// sometimes a lens; `None` when no place was found that sees the middle and enough of the scene.
pub(super) fn camera(scene: &Scene, original: &Perspective, dice: &mut Dice) -> Option<Camera> {
    let file_camera = Camera::perspective(original).ok()?;
    let subject = subject(scene, original, &file_camera)?;
    (0..TRIES).find_map(|_| {
        let drawn = draw(original, &subject, dice)?;
        let camera = Camera::perspective(&drawn).ok()?;
        is_good(scene, &subject, &camera).then_some(camera)
    })
}

fn subject(scene: &Scene, original: &Perspective, camera: &Camera) -> Option<Subject> {
    let eye = original.to_world.w_axis.truncate();
    let rays = grid(scene, camera);
    let mut hits: Vec<(f32, Ray)> =
        rays.iter().filter_map(|ray| Some((scene.geometry.intersect(ray)?.t, *ray))).collect();
    let coverage = hits.len() as f64 / rays.len() as f64;
    if hits.is_empty() {
        let (low, high) = scene.geometry.bounds()?;
        let target = (low.as_dvec3() + high.as_dvec3()) * 0.5;
        return Some(Subject { target, normal: None, distance: eye.distance(target), coverage });
    }
    // The middle one by distance: neither the wall behind nor the leaf before the lens.
    hits.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let (_, ray) = hits[hits.len() / 2];
    let hit = scene.geometry.intersect(&ray)?;
    let at = scene.geometry.interaction(&ray, &hit);
    let towards = if at.normal.dot(ray.direction) < 0.0 { at.normal } else { -at.normal };
    let target = at.position.as_dvec3();
    let normal = Some(towards.as_dvec3());
    Some(Subject { target, normal, distance: eye.distance(target), coverage })
}

/// Another place, direction and lens.
fn draw(original: &Perspective, subject: &Subject, dice: &mut Dice) -> Option<Perspective> {
    let eye = original.to_world.w_axis.truncate();
    let up = original.to_world.y_axis.truncate().normalize();
    let side = up.cross(eye - subject.target).try_normalize()?;
    let wide = if dice.chance(0.3) { 180.0 } else { 60.0 };
    let turn = DQuat::from_axis_angle(up, dice.uniform(-wide, wide).to_radians())
        * DQuat::from_axis_angle(side, dice.uniform(-35.0, 35.0).to_radians());
    let distance = subject.distance * dice.log_uniform(0.4, 1.5);
    let eye = subject.target + turn * (eye - subject.target).try_normalize()? * distance;
    let jitter = DVec3::from([(); 3].map(|()| dice.uniform(-0.2, 0.2)));
    let forward = (subject.target + jitter * distance - eye).try_normalize()?;
    let roll = DQuat::from_axis_angle(forward, dice.uniform(-8.0, 8.0).to_radians());
    let left = roll * up.cross(forward).try_normalize()?;
    let axes = DMat3::from_cols(left, forward.cross(left), forward);
    let aperture = match (original.aperture_radius > 0.0, dice.chance(0.15)) {
        (false, false) => 0.0,
        _ => distance * dice.log_uniform(0.003, 0.03),
    };
    Some(Perspective {
        to_world: DMat4::from_translation(eye) * DMat4::from_mat3(axes),
        fov: (original.fov * dice.log_uniform(0.6, 1.5)).clamp(10.0, 110.0),
        aperture_radius: aperture,
        focus_distance: distance * dice.log_uniform(0.7, 1.4),
        ..*original
    })
}

/// Does the camera see the subject from its front, with nothing much nearer, and most of what the file's camera sees?
fn is_good(scene: &Scene, subject: &Subject, camera: &Camera) -> bool {
    let eye = camera.center().as_dvec3();
    let to_eye = eye - subject.target;
    if subject.normal.is_some_and(|normal| normal.dot(to_eye) <= 0.0) {
        return false;
    }
    let sight = Ray { t_max: 0.99, ..Ray::new(eye.as_vec3(), (-to_eye).as_vec3()) };
    if subject.normal.is_some() && scene.geometry.occluded(&sight) {
        return false;
    }
    let rays = grid(scene, camera);
    let lengths: Vec<f32> =
        rays.iter().filter_map(|ray| Some(scene.geometry.intersect(ray)?.t)).collect();
    let near = 0.1 * to_eye.length();
    let close = lengths.iter().filter(|&&length| f64::from(length) < near).count();
    let coverage = lengths.len() as f64 / rays.len() as f64;
    close * 20 <= rays.len() && coverage >= (0.6 * subject.coverage).max(0.15)
}

/// Rays through the middles of a grid of the film.
fn grid(scene: &Scene, camera: &Camera) -> Vec<Ray> {
    let size = Vec2::new(scene.film.width as f32, scene.film.height as f32);
    (0..GRID * GRID)
        .map(|index| {
            let cell = Vec2::new((index % GRID) as f32, (index / GRID) as f32);
            camera.ray((cell + 0.5) / GRID as f32 * size, Vec2::splat(0.5))
        })
        .collect()
}
