//! A ray against one triangle, watertight, in portable arithmetic: the reference for the packets of the tree.

use super::bvh::Query;

/// Parameter and barycentric weights of the second and third corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TriangleHit {
    pub(crate) t: f32,
    pub(crate) u: f32,
    pub(crate) v: f32,
}

/// The test of Woop, Benthin and Wald 2013 ("Watertight Ray/Triangle Intersection"), both sides. `corners[i][axis]`.
///
/// Two triangles that share an edge compute its edge function from the same numbers with opposite sign, so that no ray
/// passes between them. That needs every product rounded by itself: no fused multiply-add here.
#[inline(always)]
pub(crate) fn intersect(query: &Query, corners: &[[f32; 3]; 3], t_max: f32) -> Option<TriangleHit> {
    let [kx, ky, kz] = query.axes;
    let [shear_x, shear_y, scale_z] = query.shear;
    let origin = query.origin.to_array();
    let relative = |corner: usize, axis: usize| corners[corner][axis] - origin[axis];
    let [az, bz, cz] = [relative(0, kz), relative(1, kz), relative(2, kz)];
    let [ax, bx, cx] = [
        relative(0, kx) - shear_x * az,
        relative(1, kx) - shear_x * bz,
        relative(2, kx) - shear_x * cz,
    ];
    let [ay, by, cy] = [
        relative(0, ky) - shear_y * az,
        relative(1, ky) - shear_y * bz,
        relative(2, ky) - shear_y * cz,
    ];
    let mut a = cx * by - cy * bx;
    let mut b = ax * cy - ay * cx;
    let mut c = bx * ay - by * ax;
    if a == 0.0 || b == 0.0 || c == 0.0 {
        [a, b, c] = exact_edges([ax, bx, cx], [ay, by, cy]);
    }
    if !((a >= 0.0 && b >= 0.0 && c >= 0.0) || (a <= 0.0 && b <= 0.0 && c <= 0.0)) {
        return None;
    }
    // A triangle seen edge-on has determinant 0, which makes t NaN.
    let reciprocal = 1.0 / ((a + b) + c);
    let (w, u, v) = (a * reciprocal, b * reciprocal, c * reciprocal);
    let t = (((w * az) + (u * bz)) + (v * cz)) * scale_z;
    (t > 0.0 && t < t_max).then_some(TriangleHit { t, u, v })
}

/// The edge functions of a sheared triangle, of exact sign: products of two f32 are exact in f64. A difference of
/// products rounded to f32 is only in doubt where it is 0 (Woop et al. 2013, section 4).
#[cold]
pub(crate) fn exact_edges(x: [f32; 3], y: [f32; 3]) -> [f32; 3] {
    let [ax, bx, cx] = x.map(f64::from);
    let [ay, by, cy] = y.map(f64::from);
    [(cx * by - cy * bx) as f32, (ax * cy - ay * cx) as f32, (bx * ay - by * ax) as f32]
}
