//! Weights of bidirectional strategies (Veach 1997, section 10.2.1), from one ratio of densities a vertex.
//!
//! `pL_i` and `pE_i` are the densities of vertex `x_i` found from the light's and from the eye's side, both functions of the
//! finished path. The density of the path with `s + 1` vertices from the light over that with `s` is `pL_s / pE_s`, so that
//! all ratios to the strategy used come from two sweeps outwards from the connection. What lies two vertices beyond it is
//! known to the walks and kept in [`Node::tail`], so that a weight costs the same for any length of path.
//!
//! Densities are per area of the vertex, but where an event is a delta lobe: the vertex after it has the probability of the
//! lobe, the vertex before it a density per projected solid angle. What a chain of delta events has in common for both
//! sides, its generalised geometry term, then cancels (METHODS 3.2).

/// How the densities of strategies make weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heuristic {
    /// Proportional to the density: `p / Σp`.
    Balance,
    /// Proportional to its square, lower variance where one strategy is good.
    #[default]
    Power,
}

impl Heuristic {
    /// What a ratio of densities counts for.
    #[inline]
    pub fn raise(self, ratio: f64) -> f64 {
        match self {
            Self::Balance => ratio,
            Self::Power => ratio * ratio,
        }
    }
}

/// What the weights need to know of one vertex of a walk.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Node {
    /// Density with which its own walk found it, if its event is smooth.
    pub pdf: f64,
    /// The same if its event is a delta lobe.
    pub pdf_if_delta: f64,
    /// `|cos| / d²` at the vertex before: turns a density per solid angle here into one per area there. Emitters at infinity
    /// have 1, points without a surface `1 / d²`.
    pub to_previous: f64,
    /// Absolute cosine of the direction to the vertex before with the geometric normal here; 1 without a surface.
    pub cosine: f64,
    /// Is the event that the walk chose here a delta lobe?
    pub is_delta: bool,
    /// Can the walk of the other side find this end? Only of the first vertex.
    pub is_hittable: bool,
    /// All strategies that connect further towards the beginning of this walk, relative to the one that connects right
    /// after this vertex. Known once the vertex after the next one is.
    pub tail: f64,
}

impl Node {
    /// Density with the event that the walk chose.
    #[inline]
    fn chosen_pdf(&self) -> f64 {
        if self.is_delta { self.pdf_if_delta } else { self.pdf }
    }

    /// Density of the vertex before, `previous`, from a density per solid angle `pdf` of the direction to it from a smooth
    /// event here.
    #[inline]
    fn density_of(&self, previous: &Self, pdf: f64) -> f64 {
        if previous.is_delta { pdf / self.cosine } else { pdf * self.to_previous }
    }
}

/// Is there a strategy that connects `nodes[index]` with the vertex before it, or, for the first, that ends on it?
#[inline]
fn exists(nodes: &[Node], index: usize) -> f64 {
    let both_smooth = match index {
        0 => nodes[0].is_hittable,
        _ => !nodes[index].is_delta && !nodes[index - 1].is_delta,
    };
    f64::from(u8::from(both_smooth))
}

/// `numerator / denominator`, and 0 for 0/0: a strategy that cannot find the path.
#[inline]
fn ratio(numerator: f64, denominator: f64) -> f64 {
    if numerator == 0.0 { 0.0 } else { numerator / denominator }
}

/// Sets the tail of the vertex before the last, now that the walk has left the last one: `pdf` is the density of the other
/// side's direction from the last vertex to it, or the probability of the lobe if the last event is delta.
#[inline]
pub fn close(nodes: &mut [Node], pdf: f64, heuristic: Heuristic) {
    let last = nodes.len() - 1;
    let previous = last - 1;
    let found =
        if nodes[last].is_delta { pdf } else { nodes[last].density_of(&nodes[previous], pdf) };
    let beyond = if previous == 0 { 0.0 } else { nodes[previous - 1].tail };
    let factor = heuristic.raise(ratio(found, nodes[previous].chosen_pdf()));
    nodes[previous].tail = product(factor, exists(nodes, previous) + beyond);
}

/// `a · b`, and 0 where one is 0 and the other infinite.
#[inline]
fn product(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}

/// Sum of all strategies that connect nearer to the beginning of a walk than after its last vertex `nodes.last()`, relative
/// to the one that connects there. Its event is smooth whatever the walk chose. `pdf` is the density, in the measure of
/// [`Node::pdf`], with which the other side finds the last vertex; `pdf_previous` that of the direction from there to the
/// vertex before, per solid angle.
#[inline]
pub fn others(nodes: &[Node], pdf: f64, pdf_previous: f64, heuristic: Heuristic) -> f64 {
    match nodes {
        [] => 0.0,
        [nodes @ .., last] => others_before(nodes, last, pdf, pdf_previous, heuristic),
    }
}

/// The same with the last vertex apart from those before.
#[inline]
pub fn others_before(
    nodes: &[Node],
    last: &Node,
    pdf: f64,
    pdf_previous: f64,
    heuristic: Heuristic,
) -> f64 {
    let factor = heuristic.raise(ratio(pdf, last.pdf));
    if nodes.is_empty() {
        return product(factor, f64::from(u8::from(last.is_hittable)));
    }
    let previous = nodes.len() - 1;
    let found = last.density_of(&nodes[previous], pdf_previous);
    let beyond = if previous == 0 { 0.0 } else { nodes[previous - 1].tail };
    let factor_previous = heuristic.raise(ratio(found, nodes[previous].chosen_pdf()));
    let connects = f64::from(u8::from(!nodes[previous].is_delta));
    product(factor, connects + product(factor_previous, exists(nodes, previous) + beyond))
}

/// Of the sum of [`others`] only the strategy that connects right before the last vertex.
#[inline]
pub fn nearest_other(nodes: &[Node], pdf: f64, heuristic: Heuristic) -> f64 {
    let last = nodes.len() - 1;
    let connects = last > 0 && !nodes[last - 1].is_delta;
    if connects { heuristic.raise(ratio(pdf, nodes[last].pdf)) } else { 0.0 }
}

/// Weight of the strategy used, from the sums of both sides. Where they are not finite some other strategy finds the path
/// infinitely more often, and the weight is 0.
#[inline]
pub fn weight(light: f64, eye: f64) -> f64 {
    let total = 1.0 + light + eye;
    if total.is_finite() { 1.0 / total } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// METHODS N.4: k = 2, pL = (2, 3, ·), pE = (5, 7, 1); strategies 0, 1, 2 exist. Balance weights 0.636364, 0.254545,
    /// 0.109091.
    #[test]
    fn ratios_give_the_weights_of_the_worked_example() {
        let node = |pdf, is_hittable| Node {
            pdf,
            to_previous: 1.0,
            cosine: 1.0,
            is_hittable,
            ..Node::default()
        };
        let expected = [0.636_364, 0.254_545, 0.109_091];
        // s = 0: the eye's walk found all three vertices, x_2 first; the light finds x_0 with 2 and x_1 with 3.
        let mut eye = vec![node(1.0, false), node(7.0, false)];
        // The tail of x_2 holds nothing, for the lens cannot be hit.
        close(&mut eye, 9.0, Heuristic::Balance);
        eye.push(node(5.0, false));
        let weights = [
            weight(0.0, others(&eye, 2.0, 3.0, Heuristic::Balance)),
            weight(
                others(&[node(2.0, true)], 5.0, 0.0, Heuristic::Balance),
                others(&eye[..2], 3.0, 9.0, Heuristic::Balance),
            ),
            weight(
                others(&[node(2.0, true), node(3.0, false)], 7.0, 5.0, Heuristic::Balance),
                others(&eye[..1], 9.0, 0.0, Heuristic::Balance),
            ),
        ];
        for (found, expected) in weights.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{weights:?}");
        }
    }

    #[test]
    fn densities_without_bound_leave_the_path_to_another_strategy() {
        let node = Node {
            pdf: 1e-300,
            to_previous: 1.0,
            cosine: 1.0,
            is_hittable: true,
            ..Node::default()
        };
        assert_eq!(weight(others(&[node], 1e300, 0.0, Heuristic::Power), 0.0), 0.0);
        // Nobody finds it: no such strategy.
        let none = Node { pdf: 0.0, ..node };
        assert_eq!(weight(others(&[none], 0.0, 0.0, Heuristic::Power), 0.0), 1.0);
    }
}
