//! Meshes by formula: boxes, prisms, surfaces of revolution, tubes, and surfaces displaced by noise.

use super::mesh::Mesh;
use super::noise::Noise;
use super::random::Random;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The box between two corners; texture coordinates are metres on each face.
pub(super) fn cuboid(low: DVec3, high: DVec3) -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for is_high in [false, true] {
            let corner = |a: bool, b: bool| {
                let mut p = low;
                p[axis] = if is_high { high[axis] } else { low[axis] };
                p[u] = if a { high[u] } else { low[u] };
                p[v] = if b { high[v] } else { low[v] };
                p
            };
            let corners = [
                corner(false, false),
                corner(true, false),
                corner(true, true),
                corner(false, true),
            ];
            let uvs = corners.map(|p| {
                // Upright on walls: v is the height wherever a face has one.
                match axis {
                    0 => DVec2::new(p.z, p.y),
                    1 => DVec2::new(p.x, p.z),
                    _ => DVec2::new(p.x, p.y),
                }
            });
            push_polygon(&mut mesh, &corners, &uvs, !is_high);
        }
    }
    mesh
}

/// A flat convex polygon, counter-clockwise unless `reversed`, as a fan with its own vertices.
pub(super) fn push_polygon(mesh: &mut Mesh, corners: &[DVec3], uvs: &[DVec2], reversed: bool) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(corners);
    mesh.uvs.extend(uvs);
    for k in 2..corners.len() as u32 {
        let (b, c) = if reversed { (k, k - 1) } else { (k - 1, k) };
        mesh.push_triangle([first, first + b, first + c]);
    }
}

/// An upright prism or frustum over a star-shaped outline around the axis (counter-clockwise seen from above), faceted.
/// The top is the outline scaled by `taper` and turned by `twist` radians, in `steps` steps.
pub(super) fn prism(outline: &[DVec2], height: f64, taper: f64, twist: f64, steps: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let ring = |t: f64, index: usize| {
        let p = DVec2::from_angle(twist * t).rotate(outline[index % outline.len()]);
        let p = p * (1.0 + (taper - 1.0) * t);
        // Counter-clockwise seen from above is from +z to +x.
        DVec3::new(p.x, t * height, -p.y)
    };
    let count = outline.len();
    for step in 0..steps {
        let (low, high) = (step as f64 / steps as f64, (step + 1) as f64 / steps as f64);
        for index in 0..count {
            let u = |i: usize| i as f64 / count as f64;
            let corners =
                [ring(low, index), ring(low, index + 1), ring(high, index + 1), ring(high, index)];
            let uvs = [
                DVec2::new(u(index), low),
                DVec2::new(u(index + 1), low),
                DVec2::new(u(index + 1), high),
                DVec2::new(u(index), high),
            ];
            push_polygon(&mut mesh, &corners, &uvs, false);
        }
    }
    for (t, reversed) in [(0.0, true), (1.0, false)] {
        let center = DVec3::new(0.0, t * height, 0.0);
        for index in 0..count {
            let corners = [center, ring(t, index), ring(t, index + 1)];
            let uvs = corners.map(|p| DVec2::new(p.x, p.z));
            push_polygon(&mut mesh, &corners, &uvs, reversed);
        }
    }
    mesh
}

/// A regular polygon or star with this many corners: radii alternate between 1 and `inner`.
pub(super) fn star(corners: usize, inner: f64) -> Vec<DVec2> {
    (0..corners)
        .map(|k| {
            let radius = if k % 2 == 1 { inner } else { 1.0 };
            DVec2::from_angle(TAU * k as f64 / corners as f64) * radius
        })
        .collect()
}

/// The surface swept by a profile of radius and height around the y axis. Going up along the profile has the outside to
/// the right, so that a closed profile bounds a solid.
pub(super) fn revolve(profile: &[DVec2], segments: usize) -> Mesh {
    let last = profile.len() - 1;
    Mesh::grid(segments, last, |u, v| {
        let p = profile[((v * last as f64).round() as usize).min(last)];
        // At the seam the same point exactly, so that normals join there.
        let angle = if u >= 1.0 { 0.0 } else { -TAU * u };
        (DVec3::new(p.x * angle.cos(), p.y, p.x * angle.sin()), DVec2::new(u, v))
    })
}

/// Points of a smooth curve through the given ones (Catmull and Rom 1974), `steps` for each span.
pub(super) fn smooth_curve<P>(points: &[P], steps: usize) -> Vec<P>
where
    P: Copy
        + std::ops::Mul<f64, Output = P>
        + std::ops::Add<P, Output = P>
        + std::ops::Sub<P, Output = P>,
{
    let at = |index: isize| points[index.clamp(0, points.len() as isize - 1) as usize];
    let mut curve = Vec::new();
    for span in 0..points.len() as isize - 1 {
        let [a, b, c, d] = [at(span - 1), at(span), at(span + 1), at(span + 2)];
        for step in 0..steps {
            let t = step as f64 / steps as f64;
            let cubic = (b - c) * 3.0 + d - a;
            let square = a * 2.0 - b * 5.0 + c * 4.0 - d;
            curve.push(b + ((c - a) * t + square * (t * t) + cubic * (t * t * t)) * 0.5);
        }
    }
    curve.extend(points.last().copied());
    curve
}

/// A tube of this radius around a curve, open at its ends or closed to a ring. Frames are carried along by the smallest
/// turn (Bloomenthal 1990, "Calculation of Reference Frames along a Space Curve").
pub(super) fn tube(
    curve: &[DVec3],
    radius: impl Fn(f64) -> f64,
    sides: usize,
    is_closed: bool,
) -> Mesh {
    let count = curve.len();
    let tangent = |i: usize| {
        let (before, after) = if is_closed {
            (curve[(i + count - 1) % count], curve[(i + 1) % count])
        } else {
            (curve[i.saturating_sub(1)], curve[(i + 1).min(count - 1)])
        };
        (after - before).normalize_or(DVec3::Y)
    };
    let mut normals = vec![tangent(0).any_orthonormal_vector()];
    for i in 1..count {
        let (t, n) = (tangent(i), normals[i - 1]);
        normals.push((n - t * n.dot(t)).normalize_or(t.any_orthonormal_vector()));
    }
    let rows = if is_closed { count } else { count - 1 };
    // The frame does not come back to itself around a ring: the rest of the turn is spread evenly.
    let rest = if is_closed {
        let (t, n) = (tangent(0), normals[count - 1]);
        let n = (n - t * n.dot(t)).normalize_or(normals[0]);
        n.cross(normals[0]).dot(t).atan2(n.dot(normals[0]))
    } else {
        0.0
    };
    Mesh::grid(sides, rows, |u, v| {
        let row = (v * rows as f64).round() as usize;
        let i = row % count;
        let (t, n) = (tangent(i), normals[i]);
        let angle = if u >= 1.0 { 0.0 } else { TAU * u };
        let angle = angle + if row == count { 0.0 } else { rest * v };
        let offset = n * angle.cos() + t.cross(n) * angle.sin();
        (curve[i] + offset * radius(v), DVec2::new(u, v))
    })
}

/// The direction at shares `u` of a turn and `v` from the lower to the upper pole.
pub(super) fn on_sphere(u: f64, v: f64) -> DVec3 {
    let theta = PI * v;
    let phi = if u >= 1.0 { 0.0 } else { -TAU * u };
    let radius = if v <= 0.0 || v >= 1.0 { 0.0 } else { theta.sin() };
    DVec3::new(radius * phi.cos(), -theta.cos(), radius * phi.sin())
}

/// A sphere of radius about 1 displaced by noise.
pub(super) fn bumpy_sphere(random: &mut Random, segments: usize) -> Mesh {
    let noise = Noise::new(random.seed());
    let (scale, octaves) = (random.uniform(0.8, 4.0), random.integer(1, 5));
    let height = random.uniform(0.1, 0.6) / scale.sqrt();
    Mesh::grid(segments, segments / 2, |u, v| {
        let direction = on_sphere(u, v);
        let offset = height * noise.space_octaves(direction * scale, octaves);
        (direction * (1.0 + offset), DVec2::new(u, v))
    })
}

/// A superquadric (Barr 1981, "Superquadrics and Angle-Preserving Transformations"): from a rounded box over an ellipsoid
/// to a star, of half-extent about 1.
pub(super) fn superquadric(random: &mut Random, segments: usize) -> Mesh {
    let exponent = |random: &mut Random| random.log_uniform(0.15, 2.2);
    let (east, north) = (exponent(random), exponent(random));
    let extent =
        DVec3::new(random.uniform(0.5, 1.0), random.uniform(0.5, 1.3), random.uniform(0.5, 1.0));
    let power = |value: f64, exponent: f64| value.signum() * value.abs().powf(exponent);
    Mesh::grid(segments, segments / 2, |u, v| {
        let theta = PI * (v - 0.5);
        let phi = if u >= 1.0 { 0.0 } else { -TAU * u };
        let ring = if v <= 0.0 || v >= 1.0 { 0.0 } else { power(theta.cos(), north) };
        let p = DVec3::new(
            ring * power(phi.cos(), east),
            power(theta.sin(), north),
            ring * power(phi.sin(), east),
        );
        (p * extent, DVec2::new(u, v))
    })
}

/// A sheet over `[-1, 1]²` in x and z with heights of noise; texture coordinates are `[0, 1]²`, times `metres`.
pub(super) fn sheet(segments: usize, metres: f64, height: impl Fn(f64, f64) -> f64) -> Mesh {
    Mesh::grid(segments, segments, |u, v| {
        let (x, z) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
        (DVec3::new(x, height(x, z), z), DVec2::new(u, v) * metres)
    })
}

/// A ring of radius 1 with this tube radius.
pub(super) fn torus(radius: f64, segments: usize) -> Mesh {
    let curve: Vec<DVec3> = (0..segments)
        .map(|i| {
            let angle = TAU * i as f64 / segments as f64;
            DVec3::new(angle.cos(), 0.0, angle.sin())
        })
        .collect();
    tube(&curve, |_| radius, segments / 2, true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The volume inside a closed mesh by the divergence theorem: a sixth of the sum of triple products; positive where
    /// triangles are counter-clockwise from outside.
    fn volume(mesh: &Mesh) -> f64 {
        let corners = mesh.triangles.iter().map(|t| t.map(|i| mesh.positions[i as usize]));
        corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    #[test]
    fn solids_have_their_volumes_and_face_outward() {
        let close = |found: f64, expected: f64, share: f64| {
            assert!((found - expected).abs() < share * expected, "{found}, expected {expected}");
        };
        close(volume(&cuboid(DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 3.0, 2.5))), 3.0, 1e-9);
        // A frustum of base area 2 (a square of radius 1) and taper 1/2: h/3 (A + sqrt(AB) + B) = 2/3 · (1 + 1/2 + 1/4).
        close(volume(&prism(&star(4, 1.0), 1.0, 0.5, 0.0, 1)), 2.0 * 1.75 / 3.0, 1e-9);
        let cone = [DVec2::ZERO, DVec2::new(1.0, 0.0), DVec2::new(0.0, 3.0)];
        close(volume(&revolve(&cone, 256)), PI, 1e-3);
        close(volume(&torus(0.25, 128)), 2.0 * PI * PI * 0.0625, 5e-3);
        let mut random = Random::new(4, 0);
        for _ in 0..8 {
            assert!(volume(&bumpy_sphere(&mut random, 32)) > 0.5);
            assert!(volume(&superquadric(&mut random, 32)) > 0.05);
        }
    }

    #[test]
    fn curves_pass_through_their_points_and_normals_point_outward() {
        let points = [DVec2::ZERO, DVec2::new(1.0, 2.0), DVec2::new(3.0, 1.0)];
        let curve = smooth_curve(&points, 5);
        assert_eq!([curve[0], curve[5], curve[10]], points);
        let sphere = Mesh::grid(32, 16, |u, v| (on_sphere(u, v), DVec2::new(u, v)));
        let outward = sphere.positions.iter().zip(&sphere.normals);
        // One-sided normals at the seam or the poles would be off by half a cell: 5.6°, whose cosine is 0.9952.
        let worst = outward.map(|(p, n)| p.dot(*n)).fold(1.0, f64::min);
        assert!(worst > 0.998, "{worst}");
    }
}
