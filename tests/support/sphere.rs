//! Cells on the sphere: counting directions in them, integrating densities over them.

use super::chi_square::{ChiSquare, chi_square};
use glam::Vec3;
use quietlight::math::Frame;
use std::f64::consts::PI;

/// A grid of cells in polar coordinates around an axis.
#[derive(Clone, Debug)]
pub(crate) struct SphereGrid {
    frame: Frame,
    /// Ascending polar angles, from 0 to π.
    theta: Vec<f64>,
    columns: usize,
}

impl SphereGrid {
    /// Rows of equal solid angle around `axis`; an even number of them has an edge at the equator.
    pub(crate) fn uniform(axis: Vec3, rows: usize, columns: usize) -> Self {
        let theta = (0..=rows).map(|i| (1.0 - 2.0 * i as f64 / rows as f64).acos()).collect();
        Self { frame: Frame::from_normal(axis), theta, columns }
    }

    /// Rows that crowd around `axis`: half of them within `width` radians of it. For peaked densities.
    pub(crate) fn crowded(axis: Vec3, width: f64, rows: usize, columns: usize) -> Self {
        let last = PI / (PI + width);
        let theta = (0..=rows)
            .map(|i| {
                let t = last * i as f64 / rows as f64;
                width * t / (1.0 - t)
            })
            .collect();
        Self { frame: Frame::from_normal(axis), theta, columns }
    }

    /// Number of cells.
    pub(crate) fn len(&self) -> usize {
        (self.theta.len() - 1) * self.columns
    }

    /// The cell that holds a direction.
    pub(crate) fn cell(&self, direction: Vec3) -> usize {
        let along = |axis: Vec3| direction.as_dvec3().dot(axis.as_dvec3());
        let (x, y, z) =
            (along(self.frame.tangent), along(self.frame.bitangent), along(self.frame.normal));
        let theta = x.hypot(y).atan2(z);
        let phi = y.atan2(x).rem_euclid(2.0 * PI);
        let row =
            self.theta.partition_point(|&edge| edge <= theta).clamp(1, self.theta.len() - 1) - 1;
        let column = ((phi / (2.0 * PI) * self.columns as f64) as usize).min(self.columns - 1);
        row * self.columns + column
    }

    /// The integral of `density` (per steradian) over every cell, by adaptive quadrature.
    pub(crate) fn integrate(&self, density: impl Fn(Vec3) -> f64) -> Vec<f64> {
        let integrand = |theta: f64, phi: f64| {
            let (sin, cos) = theta.sin_cos();
            let local = Vec3::new((sin * phi.cos()) as f32, (sin * phi.sin()) as f32, cos as f32);
            density(self.frame.to_world(local).normalize()) * sin
        };
        let mut cells = Vec::with_capacity(self.len());
        for row in self.theta.windows(2) {
            for column in 0..self.columns {
                let phi = |edge: usize| 2.0 * PI * edge as f64 / self.columns as f64;
                let whole = Rectangle { x: [row[0], row[1]], y: [phi(column), phi(column + 1)] };
                cells.push(
                    whole
                        .quarters()
                        .map(|q| refine(&integrand, q, q.gauss(&integrand), 0))
                        .iter()
                        .sum(),
                );
            }
        }
        cells
    }

    /// χ² of `total` draws from `sample` (`None` is a draw that was absorbed) against `density`, per steradian.
    pub(crate) fn test(
        &self,
        total: u64,
        mut sample: impl FnMut() -> Option<Vec3>,
        density: impl Fn(Vec3) -> f64,
    ) -> ChiSquare {
        let mut counts = vec![0u64; self.len()];
        for _ in 0..total {
            if let Some(direction) = sample() {
                counts[self.cell(direction)] += 1;
            }
        }
        chi_square(&counts, &self.integrate(density), total)
    }
}

#[derive(Clone, Copy)]
struct Rectangle {
    x: [f64; 2],
    y: [f64; 2],
}

impl Rectangle {
    fn quarters(self) -> [Self; 4] {
        let (xm, ym) = (0.5 * (self.x[0] + self.x[1]), 0.5 * (self.y[0] + self.y[1]));
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        [
            Self { x: [x0, xm], y: [y0, ym] },
            Self { x: [xm, x1], y: [y0, ym] },
            Self { x: [x0, xm], y: [ym, y1] },
            Self { x: [xm, x1], y: [ym, y1] },
        ]
    }

    /// Gauss-Legendre quadrature with 3×3 points, exact for polynomials of degree five in each variable.
    fn gauss(self, f: &impl Fn(f64, f64) -> f64) -> f64 {
        const NODES: [(f64, f64); 3] = [
            (-0.774_596_669_241_483_4, 5.0 / 18.0),
            (0.0, 8.0 / 18.0),
            (0.774_596_669_241_483_4, 5.0 / 18.0),
        ];
        let at = |[a, b]: [f64; 2], node: f64| 0.5 * (a + b) + 0.5 * (b - a) * node;
        let mut sum = 0.0;
        for (x, wx) in NODES {
            for (y, wy) in NODES {
                sum += wx * wy * f(at(self.x, x), at(self.y, y));
            }
        }
        sum * (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])
    }
}

/// Halves a rectangle both ways until its quarters agree with it: 1e-4 relative (the error is then
/// far smaller) or 1e-8 absolute, a hundredth of a count
/// in a million draws; deeper than eight only discontinuities go, whose cells are then negligibly small.
fn refine(f: &impl Fn(f64, f64) -> f64, whole: Rectangle, estimate: f64, depth: u32) -> f64 {
    let quarters = whole.quarters().map(|q| (q, q.gauss(f)));
    let better: f64 = quarters.iter().map(|(_, value)| value).sum();
    if depth == 8 || (better - estimate).abs() <= 1e-8 + 1e-4 * better.abs() {
        return better;
    }
    quarters.iter().map(|&(q, value)| refine(f, q, value, depth + 1)).sum()
}

#[test]
fn cells_cover_the_sphere_once() {
    let axis = Vec3::new(0.4, -0.2, 0.7).normalize();
    for grid in [SphereGrid::uniform(axis, 20, 40), SphereGrid::crowded(axis, 0.01, 20, 40)] {
        let areas = grid.integrate(|_| 1.0);
        let area: f64 = areas.iter().sum();
        assert!((area - 4.0 * PI).abs() < 1e-5 * area, "{area}");
        let mut random = super::random::Random::new(3);
        let uniform = grid.test(100_000, || Some(random.next_direction()), |_| 0.25 / PI);
        assert!(uniform.p > 1e-3, "{uniform:?}");
        // The same directions are not distributed as the cosine around the axis.
        let cosine = grid.test(
            100_000,
            || Some(random.next_direction()),
            |w| w.dot(axis).max(0.0) as f64 / PI,
        );
        assert!(cosine.p < 1e-6, "{cosine:?}");
    }
}

#[test]
fn a_narrow_peak_integrates_to_one() {
    let axis = Vec3::new(0.4, -0.2, 0.7).normalize();
    let width: f64 = 0.01;
    let frame = Frame::from_normal(axis);
    let peak = |w: Vec3| {
        let local = frame.to_local(w);
        let tan2 =
            f64::from(local.x).hypot(f64::from(local.y)).powi(2) / f64::from(local.z).powi(2);
        let d = 1.0
            / (PI
                * width
                * width
                * f64::from(local.z).powi(4)
                * (1.0 + tan2 / (width * width)).powi(2));
        if local.z > 0.0 { d * f64::from(local.z) } else { 0.0 }
    };
    let mass: f64 = SphereGrid::crowded(axis, width, 20, 40).integrate(peak).iter().sum();
    assert!((mass - 1.0).abs() < 1e-4, "{mass}");
}
