//! Laws of rays: what is hit does not depend on the tree, no ray slips through an edge, none meets the surface it left.

mod given;

use given::{Loose, Numbers, PLACES, ball, center, cube, shapes, soup};
use glam::Vec3;
use quietlight::geometry::{Geometry, Mesh, Part, Ray};

#[test]
fn the_nearest_of_all_triangles_is_hit() {
    let mut numbers = Numbers(1);
    let mesh = soup(&mut numbers, 2000);
    let loose = Loose::new(&mesh);
    let geometry = Geometry::new(vec![Part::Mesh(mesh)]);
    let mut hits = 0;
    for _ in 0..5000 {
        let ray = Ray::new(
            numbers.cube() * 2.0,
            numbers.direction() * 10f32.powf(6.0 * numbers.unit() - 3.0),
        );
        let expected = loose.nearest(&ray);
        let hit = geometry.intersect(&ray);
        assert!(
            hit.map_or(expected.is_empty(), |hit| expected.contains(&hit)),
            "{ray:?}: {hit:?}, not {expected:?}"
        );
        assert_eq!(geometry.occluded(&ray), hit.is_some(), "{ray:?}");
        hits += usize::from(hit.is_some());
    }
    assert!((1000..4900).contains(&hits), "{hits} hits say little");
}

#[test]
fn rays_along_axes_and_in_planes_of_boxes_are_no_exception() {
    let mut numbers = Numbers(2);
    let mut mesh = Mesh::default();
    let mut lattice = |size: usize| {
        Vec3::from_array([0; 3].map(|_| numbers.below(size) as f32 - (size / 2) as f32))
    };
    // Axis-aligned triangles with corners on a lattice, so that rays from the lattice run in planes of their boxes.
    while mesh.triangles.len() < 400 {
        let first = lattice(9);
        let corners = [first, first + lattice(3), first + lattice(3)];
        if (corners[1] - first).cross(corners[2] - first) != Vec3::ZERO {
            let start = mesh.positions.len() as u32;
            mesh.positions.extend(corners);
            mesh.triangles.push([start, start + 1, start + 2]);
        }
    }
    let rays: Vec<Ray> = (0..4000).map(|_| Ray::new(lattice(15), lattice(3))).collect();
    let loose = Loose::new(&mesh);
    let geometry = Geometry::new(vec![Part::Mesh(mesh)]);
    let mut hits = 0;
    for mut ray in rays {
        // Both zeros: 1/0 has a sign.
        for zero in [0.0, -0.0] {
            ray.direction =
                ray.direction.map(|component| if component == 0.0 { zero } else { component });
            let expected = loose.nearest(&ray);
            let hit = geometry.intersect(&ray);
            let is_right = hit.map_or(expected.is_empty(), |hit| expected.contains(&hit));
            assert!(is_right, "{ray:?}: {hit:?}, not {expected:?}");
            hits += usize::from(hit.is_some());
        }
    }
    assert!(hits > 1000, "{hits} hits say little");
}

#[test]
fn portable_and_avx2_traversal_agree_bit_by_bit() {
    let mut numbers = Numbers(3);
    let mut parts = vec![
        Part::Mesh(soup(&mut numbers, 3000)),
        Part::Mesh(ball(4, 0.9, Vec3::ZERO)),
        Part::Mesh(cube(Vec3::splat(-0.5), Vec3::ONE)),
    ];
    parts.extend(shapes(&mut numbers, 60));
    let simd = Geometry::new(parts.clone());
    let portable = Geometry::new(parts).without_simd();
    let bits = |hit: Option<quietlight::geometry::Hit>| {
        hit.map(|hit| (hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive))
    };
    for index in 0..40_000 {
        let direction = match index % 4 {
            0 => numbers.direction().round(),
            _ => numbers.direction(),
        };
        let origin = if index % 3 == 0 {
            (numbers.cube() * 2.0).round() * 0.5
        } else {
            numbers.cube() * 2.0
        };
        let t_max = if index % 5 == 0 { numbers.unit() } else { f32::INFINITY };
        let ray = Ray { origin, direction, t_max };
        assert_eq!(bits(simd.intersect(&ray)), bits(portable.intersect(&ray)), "{ray:?}");
        assert_eq!(simd.occluded(&ray), portable.occluded(&ray), "{ray:?}");
        assert_eq!(simd.occluded(&ray), simd.intersect(&ray).is_some(), "{ray:?}");
    }
}

#[test]
fn no_ray_leaks_through_a_shared_edge_or_vertex() {
    let mut numbers = Numbers(4);
    for (scale, offset) in PLACES {
        let mesh = ball(4, scale, center(offset));
        let geometry = Geometry::new(vec![Part::Mesh(mesh.clone())]);
        assert_eq!(geometry.rejected().total(), 0);
        let mut leaks = [0; 2];
        for _ in 0..100_000 {
            let origin = center(offset) + numbers.cube() * (0.5 * scale);
            let [a, b, _] = mesh.triangles[numbers.below(mesh.triangles.len())]
                .map(|index| mesh.positions[index as usize]);
            let on_edge = a.lerp(b, numbers.unit());
            for (leaks, target) in leaks.iter_mut().zip([on_edge, a]) {
                let ray = Ray::new(origin, target - origin);
                *leaks += usize::from(geometry.intersect(&ray).is_none());
                assert_eq!(geometry.occluded(&ray), geometry.intersect(&ray).is_some());
            }
        }
        assert_eq!(leaks, [0, 0], "leaks at edges and vertices, scale {scale}, offset {offset}");
    }
}

#[test]
fn no_ray_hits_the_triangle_that_it_leaves() {
    let mut numbers = Numbers(5);
    for (scale, offset) in PLACES {
        let middle = center(offset);
        let placed = |mesh: Mesh| Mesh {
            positions: mesh.positions.iter().map(|position| middle + *position * scale).collect(),
            ..mesh
        };
        // A face of the second box lies in a coordinate plane, where the position itself has no error at all.
        let boxes = [(-Vec3::ONE, Vec3::ONE), (Vec3::new(-0.7, -0.6, 0.0), Vec3::ONE)];
        let mut meshes = vec![ball(3, scale, middle)];
        meshes.extend(boxes.map(|(low, high)| placed(cube(low, high))));
        if offset == 0.0 {
            // Rounded far from the origin, a needle is not convex.
            let mut needle = ball(3, 1.0, Vec3::ZERO);
            needle
                .positions
                .iter_mut()
                .for_each(|position| *position *= Vec3::new(1.0, 0.01, 0.02));
            meshes.push(placed(needle));
        }
        for mesh in meshes {
            let geometry = Geometry::new(vec![Part::Mesh(mesh.clone())]);
            let (mut outside, mut inside, mut lost, mut tried) = (0, 0, 0, 0);
            for _ in 0..50_000 {
                let corners = mesh.triangles[numbers.below(mesh.triangles.len())];
                let [a, b, c] = corners.map(|index| mesh.positions[index as usize]);
                let target = a.lerp(b, numbers.unit()).lerp(c, numbers.unit());
                let origin = middle + numbers.cube() * (3.0 * scale);
                let arriving = Ray::new(origin, target - origin);
                let Some(hit) = geometry.intersect(&arriving) else { continue };
                let at = geometry.interaction(&arriving, &hit);
                tried += 1;
                outside += usize::from(geometry.occluded(&at.spawn(numbers.grazing(at.normal))));
                // A point that may lie beyond the edge, for all that its error says, may look past its neighbour.
                let is_beyond_doubt = hit.u.min(hit.v).min(1.0 - hit.u - hit.v) * scale
                    > 100.0 * at.error.max_element();
                match geometry.intersect(&at.spawn(numbers.grazing(-at.normal))) {
                    Some(through) => inside += usize::from(through.primitive == hit.primitive),
                    None => lost += usize::from(is_beyond_doubt),
                }
            }
            assert!(tried > 20_000, "{tried} hits say little");
            assert_eq!(
                (outside, inside, lost),
                (0, 0, 0),
                "of {tried} at scale {scale}, offset {offset}"
            );
        }
    }
}

#[test]
fn no_ray_hits_the_sphere_that_it_leaves() {
    let mut numbers = Numbers(6);
    for (radius, offset) in PLACES {
        let center = center(offset);
        let geometry = Geometry::new(vec![Part::Sphere { center, radius, flip_normals: false }]);
        for _ in 0..50_000 {
            let (from, to) = (numbers.cube() * (3.0 * radius), numbers.cube() * (0.5 * radius));
            let arriving = Ray::new(center + from, to - from);
            let Some(hit) = geometry.intersect(&arriving) else { continue };
            let at = geometry.interaction(&arriving, &hit);
            let leaving = at.spawn(numbers.grazing(at.normal));
            assert!(!geometry.occluded(&leaving), "{leaving:?} of radius {radius} at {center}");
            // Through the inside it comes to the other end of the chord.
            let wi = numbers.grazing(-at.normal);
            let chord = 2.0 * radius * wi.dot(-at.normal);
            let slack = 8.0 * (at.error.max_element() / wi.dot(-at.normal)) + 1e-5 * radius;
            let through = geometry.intersect(&at.spawn(wi)).expect("a ray inside a sphere hits it");
            assert!(
                (through.t - chord).abs() <= slack,
                "{} of {chord}, radius {radius} at {center}",
                through.t
            );
        }
    }
}

#[test]
fn an_interaction_lies_where_the_ray_hit_its_part() {
    let mut numbers = Numbers(10);
    // Shapes stand before, between and after meshes, which puts their primitives in another order than their parts.
    let mut parts = shapes(&mut numbers, 20);
    parts.insert(11, Part::Mesh(soup(&mut numbers, 200)));
    parts.insert(3, Part::Mesh(ball(2, 0.4, Vec3::splat(0.3))));
    parts.push(Part::Mesh(cube(Vec3::splat(-0.8), Vec3::splat(-0.2))));
    let alone: Vec<Geometry> = parts.iter().map(|part| Geometry::new(vec![part.clone()])).collect();
    let geometry = Geometry::new(parts);
    let mut hits = vec![0; alone.len()];
    for _ in 0..30_000 {
        let ray = Ray::new(numbers.cube() * 2.0, numbers.direction());
        let Some(hit) = geometry.intersect(&ray) else { continue };
        let at = geometry.interaction(&ray, &hit);
        assert!(
            (at.position - ray.at(hit.t)).length() < 2e-5,
            "{ray:?}: {hit:?} at {}",
            at.position
        );
        let expected = alone[at.part as usize].intersect(&ray).expect("the part is hit when alone");
        assert_eq!(
            (hit.t, hit.u, hit.v),
            (expected.t, expected.u, expected.v),
            "{ray:?} on part {}",
            at.part
        );
        hits[at.part as usize] += 1;
    }
    assert!(hits.iter().all(|&hits| hits > 0), "{hits:?}");
}

#[test]
fn only_hits_before_t_max_count() {
    let mut numbers = Numbers(7);
    let mut parts = vec![Part::Mesh(soup(&mut numbers, 500))];
    parts.extend(shapes(&mut numbers, 60));
    let geometry = Geometry::new(parts);
    let mut hits = 0;
    for _ in 0..20_000 {
        let ray = Ray::new(numbers.cube() * 2.0, numbers.direction());
        let Some(hit) = geometry.intersect(&ray) else { continue };
        hits += 1;
        for (t_max, expected) in
            [(hit.t, None), (hit.t.next_up(), Some(hit)), (0.0, None), (f32::NAN, None)]
        {
            let limited = Ray { t_max, ..ray };
            assert_eq!(geometry.intersect(&limited), expected, "{limited:?}");
            assert_eq!(geometry.occluded(&limited), expected.is_some(), "{limited:?}");
        }
    }
    assert!(hits > 2000, "{hits} hits say little");
}

#[test]
fn a_scaled_scene_is_hit_alike() {
    let mut numbers = Numbers(8);
    let mesh = soup(&mut numbers, 1000);
    let rays: Vec<Ray> =
        (0..3000).map(|_| Ray::new(numbers.cube() * 2.0, numbers.direction())).collect();
    let geometry = Geometry::new(vec![Part::Mesh(mesh.clone())]);
    // Powers of two scale every number of a test exactly.
    for scale in [2f32.powi(-30), 2f32.powi(30)] {
        let positions = mesh.positions.iter().map(|position| *position * scale).collect();
        let scaled = Geometry::new(vec![Part::Mesh(Mesh { positions, ..mesh.clone() })]);
        for ray in &rays {
            let expected = geometry.intersect(ray).map(|hit| (hit.t * scale, hit.primitive));
            let hit = scaled.intersect(&Ray { origin: ray.origin * scale, ..*ray });
            assert_eq!(hit.map(|hit| (hit.t, hit.primitive)), expected, "{ray:?} times {scale}");
        }
    }
}

#[test]
fn what_cannot_be_hit_is_counted_and_left_out() {
    let mut mesh = cube(Vec3::ZERO, Vec3::ONE);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::NAN, Vec3::splat(f32::INFINITY), Vec3::splat(0.5)]);
    mesh.triangles.extend([
        [0, 1, first],
        [first + 1, 1, 2],
        [0, 0, 1],
        [0, first + 2, 7],
        [0, 1, 1000],
        [u32::MAX, 1, 2],
        [1, 2, u32::MAX],
    ]);
    let sphere = |radius| Part::Sphere { center: Vec3::splat(3.0), radius, flip_normals: false };
    let parts = vec![
        sphere(f32::NAN),
        Part::Mesh(mesh),
        sphere(0.0),
        sphere(-1.0),
        sphere(1.0),
        Part::Disk { center: Vec3::ZERO, axes: [Vec3::X, Vec3::X], flip_normals: false },
        Part::Cylinder { start: Vec3::ONE, end: Vec3::ONE, radius: 1.0, flip_normals: false },
        Part::Cylinder { start: Vec3::ONE, end: Vec3::INFINITY, radius: 1.0, flip_normals: false },
    ];
    let geometry = Geometry::new(parts);
    let rejected = geometry.rejected();
    assert_eq!((rejected.out_of_range, rejected.non_finite, rejected.without_area), (3, 4, 6));
    assert_eq!(rejected.total(), 13);
    let ray = Ray::new(Vec3::new(0.4, 0.3, -1.0), Vec3::Z);
    let hit = geometry.intersect(&ray).expect("the cube is there");
    assert_eq!((hit.t, geometry.interaction(&ray, &hit).part), (1.0, 1));
    let ray = Ray::new(Vec3::new(3.0, 3.0, -7.0), Vec3::Z);
    let hit = geometry.intersect(&ray).expect("the sphere is there");
    assert_eq!((hit.t, geometry.interaction(&ray, &hit).part), (9.0, 4));
}

#[test]
fn nothing_and_nonsense_are_missed_without_a_panic() {
    let empty = Geometry::new(Vec::new());
    assert!(empty.bounds().is_none() && !empty.occluded(&Ray::new(Vec3::ZERO, Vec3::Z)));
    assert_eq!(Geometry::default().intersect(&Ray::new(Vec3::ZERO, Vec3::Z)), None);
    let only_rejected =
        Mesh { positions: vec![Vec3::ZERO], triangles: vec![[0, 0, 0]], ..Mesh::default() };
    assert!(Geometry::new(vec![Part::Mesh(only_rejected)]).bounds().is_none());
    let geometry = Geometry::new(vec![Part::Mesh(ball(3, 1.0, Vec3::ZERO))]);
    let numbers = [
        0.0,
        -0.0,
        1.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN_POSITIVE,
        1e-45,
    ];
    for a in numbers {
        for b in numbers {
            for t_max in numbers {
                let ray = Ray {
                    origin: Vec3::new(a, b, 0.1),
                    direction: Vec3::new(b, 0.3 * a, a),
                    t_max,
                };
                if let Some(hit) = geometry.intersect(&ray) {
                    assert!(
                        hit.t > 0.0 && hit.t < t_max && hit.u.is_finite() && hit.v.is_finite(),
                        "{ray:?}: {hit:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn coordinates_near_the_end_of_f32_do_not_panic() {
    let mut numbers = Numbers(9);
    for scale in [1e-44, 1e-38, 1e30, 3e38] {
        let positions = (0..300).map(|_| numbers.cube() * scale).collect();
        let triangles = (0..100).map(|index| [3 * index, 3 * index + 1, 3 * index + 2]).collect();
        let geometry =
            Geometry::new(vec![Part::Mesh(Mesh { positions, triangles, ..Mesh::default() })]);
        for _ in 0..100 {
            let ray = Ray::new(numbers.cube() * scale, numbers.direction());
            let hit = geometry.intersect(&ray);
            assert!(hit.is_none_or(|hit| hit.t.is_finite() && hit.t > 0.0));
        }
    }
}

#[test]
fn a_million_triangles_take_under_110_bytes_each() {
    // A quarter of a million here; the benches have the whole one.
    let geometry = Geometry::new(vec![Part::Mesh(ball(7, 1.0, Vec3::ZERO))]);
    assert_eq!(geometry.triangle_count(), 8 * 4usize.pow(7));
    let bytes = geometry.bytes() as f64 / geometry.triangle_count() as f64;
    assert!(bytes < 110.0, "{bytes} bytes a triangle");
}
