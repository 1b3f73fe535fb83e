use super::*;
use crate::sampler::{Sampler, SobolSampler};
use crate::scene::Perspective;
use glam::DMat4;

const NEAR: f64 = 0.5;
const FAR: f64 = 100.0;
const FOCUS: f64 = 4.0;

/// Turned and moved, 88 pixels a unit at distance 1.
fn parameters() -> Perspective {
    let turn = DMat4::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 2.0);
    Perspective {
        to_world: DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0)) * turn,
        fov: 40.0,
        film: [64, 48],
        near_clip: NEAR,
        far_clip: FAR,
        ..Perspective::default()
    }
}

fn pinhole() -> Camera {
    Camera::perspective(&parameters()).unwrap()
}

fn thin_lens() -> Camera {
    let lens = Perspective { aperture_radius: 0.25, focus_distance: FOCUS, ..parameters() };
    Camera::perspective(&lens).unwrap()
}

fn cameras() -> [Camera; 3] {
    let offset = Perspective {
        principal_point_offset: DVec2::new(0.1, -0.2),
        aperture_radius: 0.5,
        focus_distance: 1.5,
        ..parameters()
    };
    [pinhole(), thin_lens(), Camera::perspective(&offset).unwrap()]
}

/// A raster point, lens coordinates, their ray, and a share in `[0, 1)`.
fn rays(camera: &Camera) -> impl Iterator<Item = (Vec2, Vec2, Ray, f32)> {
    (0..2000).map(move |i| {
        let mut sampler = SobolSampler::new(1, 2, i);
        let raster = sampler.next_2d() * Vec2::new(64.0, 48.0);
        let lens = sampler.next_2d();
        (raster, lens, camera.ray(raster, lens), sampler.next_1d())
    })
}

#[test]
fn a_view_is_the_inverse_of_a_ray() {
    for camera in cameras() {
        for (raster, lens, ray, share) in rays(&camera) {
            // As many near points as far ones.
            let point = ray.at(ray.t_max * share.powi(4).max(1e-5));
            let view = camera.view(point, lens).unwrap();
            // The point is rounded by 2e-7 of its distance and of 4, the camera's; it is seen from 0.5 or more away, under
            // 88 pixels a unit.
            assert!((view.raster - raster).length() < 2e-4, "{raster} {view:?}");
            assert!((view.direction - ray.direction).length() < 2e-6, "{ray:?} {view:?}");
            assert!((view.start - ray.origin).length() < 2e-6, "{ray:?} {view:?}");
            let distance = point.distance(camera.lens_point(lens));
            assert!((view.distance / distance - 1.0).abs() < 2e-6, "{distance} {view:?}");
        }
    }
}

#[test]
fn a_view_ends_where_rays_end() {
    for camera in cameras() {
        for (_, lens, ray, _) in rays(&camera) {
            let sees = |t: f32| camera.view(ray.at(t), lens).is_some();
            // Points 5 from the origin are rounded to 5e-7, points at 100 to 1e-5.
            assert!(!sees(-1e-5) && sees(1e-5), "{ray:?}");
            assert!(sees(ray.t_max - 1e-4) && !sees(ray.t_max + 1e-4), "{ray:?}");
            // Behind the camera a line meets the film, too.
            assert!(!sees(-3.0), "{ray:?}");
        }
        for raster in [Vec2::new(-0.01, 10.0), Vec2::new(64.01, 10.0), Vec2::new(5.0, 48.01)] {
            let ray = camera.ray(raster, Vec2::ZERO);
            assert_eq!(camera.view(ray.at(3.0), Vec2::ZERO), None);
        }
    }
}

#[test]
fn a_view_is_always_inside_the_film() {
    // The double just below 64 rounds to 64 in single precision.
    let camera = pinhole();
    let point = camera.film_point(DVec2::new(64.0 - 1e-9, 48.0 - 1e-9)) * 2.0;
    let view = camera.view_from(DVec3::ZERO, point).unwrap();
    assert_eq!(view.raster, Vec2::new(64.0, 48.0).map(f32::next_down));
}

#[test]
fn light_that_goes_back_along_a_ray_meets_the_lens_where_it_began() {
    for camera in &cameras()[1..] {
        for (raster, lens, ray, share) in rays(camera) {
            let point = ray.at(ray.t_max * share.powi(4).max(1e-5));
            let back = Ray::new(point, -ray.direction);
            let distance = point.distance(camera.lens_point(lens));
            // A direction is rounded by 1e-7, a point by 5e-7 and by 1e-7 of its distance.
            let error = 5e-7 + 2e-7 * distance;
            let radius = camera.aperture_radius();
            let Some(hit) = camera.lens_hit(&back) else {
                let from_center = camera.lens_point(lens).distance(camera.center());
                assert!(from_center > radius - error, "{ray:?} misses the lens");
                continue;
            };
            assert!(hit.position.distance(camera.lens_point(lens)) < error, "{ray:?} {hit:?}");
            assert!(camera.lens_point(hit.lens).distance(hit.position) < 1e-6, "{hit:?}");
            // A shift of the lens point moves the image by 88 pixels a unit, times (1 / focus - 1 / depth), at most 2.
            assert!((hit.view.raster - raster).length() < 2e-4 + 176.0 * error, "{raster} {hit:?}");
            assert!((hit.view.start - ray.origin).length() < 2.0 * error + 2e-6, "{ray:?} {hit:?}");
            assert!((hit.view.distance / distance - 1.0).abs() < 1e-5, "{distance} {hit:?}");
            // From infinity the same, but that there is no distance.
            let sky = camera.lens_hit_from_infinity(&back).unwrap();
            assert_eq!((sky.position, sky.lens), (hit.position, hit.lens));
            assert!((sky.view.raster - hit.view.raster).length() < 1e-4 + 176.0 * error, "{sky:?}");
            assert!(sky.view.distance.is_infinite());
        }
    }
}

#[test]
fn light_that_does_not_come_through_the_lens_is_not_seen() {
    let camera = thin_lens();
    let along = |t: f32| camera.center() + camera.optical_axis().as_vec3() * t;
    let axis = camera.optical_axis().as_vec3();
    let side = camera.rotation.x_axis.as_vec3();
    assert!(camera.lens_hit(&Ray::new(along(3.0), -axis)).is_some());
    // A pinhole, light that goes away, light from behind.
    assert_eq!(pinhole().lens_hit(&Ray::new(along(3.0), -axis)), None);
    assert_eq!(camera.lens_hit(&Ray::new(along(3.0), axis)), None);
    assert_eq!(camera.lens_hit(&Ray::new(along(-3.0), axis)), None);
    assert_eq!(camera.lens_hit_from_infinity(&Ray::new(along(-3.0), axis)), None);
    // Just inside and just outside the rim.
    let shifted = |by: f32| Ray::new(along(3.0) + side * by, -axis);
    assert!(camera.lens_hit(&shifted(0.249)).is_some());
    assert_eq!(camera.lens_hit(&shifted(0.251)), None);
    // Before the near plane, beyond the far plane, stopped before the lens; from infinity the planes do not matter.
    for distance in [0.49, 100.1] {
        let ray = Ray::new(along(distance), -axis);
        assert_eq!(camera.lens_hit(&ray), None);
        assert!(camera.lens_hit_from_infinity(&ray).is_some());
    }
    let stopped = Ray { t_max: 2.9, ..Ray::new(along(3.0), -axis) };
    assert_eq!(camera.lens_hit(&stopped), None);
    // Through the lens but beside the film.
    let slanted = Ray::new(along(3.0) + side * 3.0, -axis - side);
    assert_eq!(camera.lens_hit(&slanted), None);
}

/// The solid angle of a rectangle at distance 1 between two corners, given across the axis: the exact formula, corner by
/// corner.
fn solid_angle(low: DVec2, high: DVec2) -> f64 {
    let corner = |x: f64, y: f64| (x * y / (1.0 + x * x + y * y).sqrt()).atan();
    (corner(low.x, low.y) - corner(high.x, low.y) - corner(low.x, high.y) + corner(high.x, high.y))
        .abs()
}

#[test]
fn the_density_of_raster_points_integrates_to_one_from_everywhere_on_the_lens() {
    for camera in cameras() {
        for lens in [Vec2::new(0.5, 0.5), Vec2::new(0.05, 0.3), Vec2::new(0.9, 0.9)] {
            let from = match camera.lens {
                None => DVec2::ZERO,
                Some(Lens { radius, focus_distance }) => {
                    square_to_disk(lens).as_dvec2() * (radius / focus_distance)
                }
            };
            let total: f64 = (0..64 * 48)
                .map(|i| {
                    let raster = DVec2::new(f64::from(i % 64), f64::from(i / 64));
                    let [low, high] = [raster, raster + 1.0]
                        .map(|raster| camera.film_point(raster).truncate() - from);
                    let middle = (raster + 0.5).as_vec2();
                    camera.raster_pdf(camera.ray(middle, lens).direction) * solid_angle(low, high)
                })
                .sum();
            // Midpoints over 64 × 48 cells are right to about a thousandth of the cells' squared size.
            assert!((total - 1.0).abs() < 1e-4, "{total}");
        }
        assert_eq!(camera.raster_pdf(-camera.optical_axis().as_vec3()), 0.0);
    }
}

#[test]
fn importance_is_the_density_of_rays_without_their_cosine() {
    for camera in cameras() {
        for (_, _, ray, _) in rays(&camera) {
            let cosine = camera.optical_axis().dot(ray.direction.as_dvec3());
            let density = camera.lens_pdf() * camera.raster_pdf(ray.direction);
            assert!((camera.importance(ray.direction) * cosine / density - 1.0).abs() < 1e-12);
        }
    }
    assert_eq!(pinhole().lens_pdf(), 1.0);
    assert!((thin_lens().lens_pdf() * PI * 0.0625 - 1.0).abs() < 1e-12);
}
