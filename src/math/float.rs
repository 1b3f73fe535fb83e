//! Bounds of rounding errors, and moving points by them.
//!
//! Every f32 operation is exact up to a factor `1 + δ`, `|δ| ≤ `[`UNIT_ROUNDOFF`]; `n` of them in a row up to
//! `1 ± gamma(n)` (Higham 2002, "Accuracy and Stability of Numerical Algorithms", lemma 3.1). Rays leave surfaces by such
//! bounds and never by an absolute distance, so that a scene works at any scale.

use glam::{Vec3, Vec3A};

/// Half the distance from 1 to the next larger f32: the largest relative error of one rounding.
pub const UNIT_ROUNDOFF: f32 = f32::EPSILON * 0.5;

/// The largest relative error of `n` roundings in a row, `nε / (1 − nε)`.
pub const fn gamma(n: u32) -> f32 {
    let n = n as f32 * UNIT_ROUNDOFF;
    n / (1.0 - n)
}

/// `point` moved along the unit vector `normal`, far enough to leave the box of half-size `error` around it, each
/// coordinate rounded away from where it was (Pharr, Jakob and Humphreys 2023, "Physically Based Rendering", 6.8.6).
/// The point lands on the side of the surface that `direction` points to.
#[inline(always)]
pub fn offset_point(point: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let normal = Vec3A::from(normal);
    let distance = normal.abs().dot(error.into());
    let is_below = Vec3A::from(direction).dot(normal) < 0.0;
    away(point, normal * if is_below { -distance } else { distance })
}

/// Both points that [`offset_point`] may give: that on the side of `normal`, and that on the other.
pub fn offset_points(point: Vec3, error: Vec3, normal: Vec3) -> [Vec3; 2] {
    let offset = Vec3A::from(normal * normal.abs().dot(error));
    [offset, -offset].map(|offset| away(point, offset))
}

/// The largest product with a number that, added to it, gives the next one: a little over half the distance to the next of
/// any (Rump, Zimmermann, Boldo and Melquiond 2009, "Computing Predecessor and Successor in Rounding to Nearest").
const STEP: f32 = UNIT_ROUNDOFF * (1.0 + f32::EPSILON);

/// `position + offset`, each coordinate rounded to the next number in the direction of its offset.
#[inline(always)]
fn away(position: Vec3, offset: Vec3A) -> Vec3 {
    let moved = Vec3A::from(position) + offset;
    let size = moved.abs();
    let moves = offset.cmpne(Vec3A::ZERO);
    // Where [`STEP`] is right, and products with it are neither subnormal nor infinite.
    let is_ordinary = size.cmpge(Vec3A::splat(1e-30)) & size.cmple(Vec3A::splat(1e38));
    if (is_ordinary | !moves).all() {
        let step = Vec3A::select(moves, size * STEP, Vec3A::ZERO);
        (moved + step.copysign(offset)).into()
    } else {
        extremely_away(position, offset.into())
    }
}

/// [`away`] for all numbers.
#[cold]
fn extremely_away(position: Vec3, offset: Vec3) -> Vec3 {
    let [x, y, z] = std::array::from_fn(|axis| next_away(position[axis], offset[axis]));
    Vec3::new(x, y, z)
}

/// `position + offset`, rounded to the next number in the direction of the offset.
fn next_away(position: f32, offset: f32) -> f32 {
    let moved = position + offset;
    if offset > 0.0 {
        moved.next_up()
    } else if offset < 0.0 {
        moved.next_down()
    } else {
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_bounds_a_chain_of_products() {
        for n in 1..40 {
            let factor = 1.1f32;
            let rounded = (0..n).fold(1.0f32, |product, _| product * factor);
            let exact = (0..n).fold(1.0f64, |product, _| product * f64::from(factor));
            assert!(
                (f64::from(rounded) - exact).abs() <= f64::from(gamma(n)) * exact,
                "{n} products"
            );
        }
        assert!(gamma(1) >= UNIT_ROUNDOFF && gamma(1) < 1.001 * UNIT_ROUNDOFF);
    }

    #[test]
    fn a_coordinate_moves_to_the_next_number_in_the_direction_of_its_offset() {
        let numbers = [0.0, 1e-45, 1e-38, 0.1, 1.0, 7.5, 1e30, f32::MAX, f32::INFINITY, f32::NAN];
        let mantissas = [1.0, 1.0f32.next_up(), 1.5f32.next_down(), 2.0f32.next_down()];
        let sizes = mantissas.map(|mantissa| [1e-20f32, 1e-3, 1.0, 8.0, 2e9].map(|s| s * mantissa));
        let numbers = numbers.into_iter().chain(sizes.into_iter().flatten());
        let both = || numbers.clone().flat_map(|number| [number, -number]);
        for position in both() {
            for offset in both() {
                let moved = position + offset;
                let expected = if offset > 0.0 {
                    moved.next_up()
                } else if offset < 0.0 {
                    moved.next_down()
                } else {
                    moved
                };
                // Alone, and beside two that are not extreme.
                let found = away(Vec3::splat(position), Vec3A::splat(offset)).x;
                let beside = away(Vec3::ONE.with_y(position), Vec3A::ONE.with_y(offset)).y;
                assert!(beside.to_bits() == found.to_bits() || found.is_nan());
                let is_same = found.to_bits() == expected.to_bits();
                assert!(is_same || (found.is_nan() && expected.is_nan()), "{position} {offset}");
            }
        }
    }

    #[test]
    fn an_offset_point_leaves_its_error_box_on_the_side_of_the_direction() {
        let normal = Vec3::new(0.6, -0.64, 0.48);
        for scale in [1e-4f32, 1.0, 1e6] {
            let point = Vec3::new(0.3, -7.0, 1e-3) * scale;
            let error = point.abs() * gamma(5);
            for side in [1.0, -1.0] {
                let moved = offset_point(point, error, normal, normal * side);
                let along =
                    (moved.as_dvec3() - point.as_dvec3()).dot(normal.as_dvec3()) * f64::from(side);
                let needed = normal.abs().as_dvec3().dot(error.as_dvec3());
                assert!(along >= needed, "moved {along}, needed {needed}");
                let both = offset_points(point, error, normal);
                assert_eq!(moved, both[usize::from(side < 0.0)]);
            }
        }
    }
}
