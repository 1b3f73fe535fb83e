//! The binary tree: obvhs clusters the boxes (PLOC; Meister and Bittner 2018, "Parallel Locally-Ordered Clustering for
//! Bounding Volume Hierarchy Construction") and optimises it (Meister and Bittner 2018, "Parallel Reinsertion for
//! Bounding Volume Hierarchy Optimization").

use super::collapse::{self, Collapsed};
use super::{Aabb, Shape};
use glam::Vec3;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Share of the nodes that the first pass of reinsertion considers; later passes consider 1/3, 1/5, ... of it. On a
/// million triangles 0.1 built in 1.5 s and 0.3 in 2.5 s, for rays 2 % faster; this lies between.
const REINSERTION: f32 = 0.2;

/// obvhs walks the tree with a stack of 192 while it reinserts, and a pass can at worst double the depth.
const REINSERTION_DEPTH: usize = 90;

/// A node of the binary tree: a pair of nodes, or one primitive.
#[derive(Clone, Copy, Debug)]
pub(super) enum Binary {
    /// Index of the first child; the second follows it.
    Pair(usize),
    /// Index of the primitive.
    Leaf(usize),
}

/// A binary tree over boxes; the root is node 0.
pub(super) struct BinaryTree {
    pub(super) nodes: Vec<Binary>,
    /// Half the surface area of each node's box, in units of the scene's size.
    pub(super) areas: Vec<f32>,
}

/// What is to be found by rays: first triangles, then shapes.
pub(super) struct Primitives<'a> {
    pub(super) triangles: &'a [(u32, [Vec3; 3])],
    pub(super) bounds: Vec<Aabb>,
}

/// Builds the wide tree so that no traversal needs a stack of more than `stack` entries.
pub(super) fn build(
    triangles: &[(u32, [Vec3; 3])],
    shapes: &[(u32, Shape)],
    stack: usize,
) -> Collapsed {
    let triangle_bounds = triangles
        .iter()
        .map(|(_, [a, b, c])| Aabb { min: a.min(*b).min(*c), max: a.max(*b).max(*c) });
    let shape_bounds = shapes.iter().map(|(_, shape)| shape.bounds());
    let bounds: Vec<Aabb> =
        triangle_bounds.chain(shape_bounds).map(|bounds| pad(&bounds)).collect();
    if bounds.is_empty() {
        return Collapsed::default();
    }
    let primitives = Primitives { triangles, bounds };
    let boxes = normalise(&primitives.bounds);
    let collapsed = collapse::collapse(&clustered(&boxes), &primitives);
    if collapsed.stack <= stack {
        collapsed
    } else {
        collapse::collapse(&balanced(&boxes), &primitives)
    }
}

/// Triangles are tested with rounding errors relative to their size, and a hit that such an error moves out of the box
/// must not be lost: a box is 4 ulp of its size larger than what it holds, and no less than one ulp of its place.
fn pad(bounds: &Aabb) -> Aabb {
    let margin = (bounds.max - bounds.min).max_element() * (4.0 * f32::EPSILON);
    let min = (bounds.min - margin).map(f32::next_down).max(Vec3::MIN);
    let max = (bounds.max + margin).map(f32::next_up).min(Vec3::MAX);
    Aabb { min, max }
}

/// The boxes in coordinates from 0 to 1, so that neither scale nor place of a scene change its tree, and no area
/// overflows or vanishes.
fn normalise(bounds: &[Aabb]) -> Vec<obvhs::aabb::Aabb> {
    let all = bounds.iter().fold(Aabb::EMPTY, |all, bounds| all.union(bounds));
    let origin = all.min.as_dvec3();
    let scale = 1.0 / (all.max.as_dvec3() - origin).max_element();
    let to_unit = |corner: Vec3| ((corner.as_dvec3() - origin) * scale).as_vec3a();
    bounds
        .iter()
        .map(|bounds| obvhs::aabb::Aabb::new(to_unit(bounds.min), to_unit(bounds.max)))
        .collect()
}

/// By obvhs.
fn clustered(boxes: &[obvhs::aabb::Aabb]) -> BinaryTree {
    let count = u32::try_from(boxes.len()).expect("fewer than 2^32 primitives");
    let mut bvh = PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Medium,
        boxes,
        (0..count).collect(),
        SortPrecision::U64,
        3,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    for pass in 0..16 {
        if depth(&bvh) > REINSERTION_DEPTH {
            break;
        }
        optimizer.run(&mut bvh, REINSERTION, Some(vec![1.0 / (2 * pass + 1) as f32]));
    }
    let nodes = bvh
        .nodes
        .iter()
        .map(|node| {
            let index = node.first_index as usize;
            if node.is_leaf() {
                Binary::Leaf(bvh.primitive_indices[index] as usize)
            } else {
                Binary::Pair(index)
            }
        })
        .collect();
    BinaryTree { nodes, areas: bvh.nodes.iter().map(|node| node.aabb().half_area()).collect() }
}

fn depth(bvh: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut stack = vec![(0, 1)];
    while let Some((index, depth)) = stack.pop() {
        let node = &bvh.nodes[index as usize];
        if node.is_leaf() {
            deepest = deepest.max(depth);
        } else {
            stack.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
        }
    }
    deepest
}

/// As shallow as can be, for primitives that cluster into a chain (sizes or distances that double and double again):
/// the middle one along the longest axis of the centres parts each node.
fn balanced(boxes: &[obvhs::aabb::Aabb]) -> BinaryTree {
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    let mut tree = BinaryTree { nodes: vec![Binary::Leaf(0)], areas: vec![0.0] };
    let mut work = vec![(0, 0..boxes.len())];
    while let Some((node, range)) = work.pop() {
        let members = &mut order[range.clone()];
        let union = members.iter().fold(obvhs::aabb::Aabb::INVALID, |all, &i| all.union(&boxes[i]));
        tree.areas[node] = union.half_area();
        if let &mut [primitive] = members {
            tree.nodes[node] = Binary::Leaf(primitive);
            continue;
        }
        let first = members.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &i| {
            let center = Vec3::from(boxes[i].center());
            (low.min(center), high.max(center))
        });
        let axis = (first.1 - first.0).max_position();
        let half = members.len() / 2;
        members.select_nth_unstable_by(half, |&i, &j| {
            boxes[i].center()[axis].total_cmp(&boxes[j].center()[axis]).then(i.cmp(&j))
        });
        let pair = tree.nodes.len();
        tree.nodes[node] = Binary::Pair(pair);
        tree.nodes.extend([Binary::Leaf(0); 2]);
        tree.areas.extend([0.0; 2]);
        work.push((pair, range.start..range.start + half));
        work.push((pair + 1, range.start + half..range.end));
    }
    tree
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::bvh::wide::Target;

    /// Triangles around the origin, each twice as large as the one before.
    fn nested(count: i32) -> Vec<(u32, [Vec3; 3])> {
        let triangle =
            [Vec3::new(1.0, -0.3, -0.2), Vec3::new(-0.4, 1.0, 0.1), Vec3::new(-0.5, -0.6, 0.9)];
        (0..count)
            .map(|i| (i as u32, triangle.map(|corner| corner * 2f32.powi(i - count / 2))))
            .collect()
    }

    #[test]
    fn a_tree_too_deep_for_the_stack_is_balanced() {
        let triangles = nested(120);
        let deep = build(&triangles, &[], usize::MAX);
        assert!(deep.stack > 40, "{} is no test", deep.stack);
        let shallow = build(&triangles, &[], 40);
        assert!(shallow.stack <= 40, "{}", shallow.stack);
        for tree in [deep, shallow] {
            let mut found: Vec<u32> =
                tree.packets.iter().flat_map(|packet| packet.primitives).collect();
            found.sort_unstable();
            found.dedup();
            assert_eq!(found, (0..120).collect::<Vec<_>>());
        }
    }

    #[test]
    fn every_box_holds_what_is_below_it() {
        let triangles: Vec<_> = nested(40)
            .into_iter()
            .flat_map(|(i, corners)| {
                [0, 1, 2, 3].map(|j| (4 * i + j, corners.map(|corner| corner + j as f32)))
            })
            .collect();
        let tree = build(&triangles, &[], usize::MAX);
        let mut seen = 0;
        for node in &tree.nodes {
            for lane in 0..8 {
                let low = Vec3::from_array(std::array::from_fn(|axis| node.planes[axis][0][lane]));
                let high = Vec3::from_array(std::array::from_fn(|axis| node.planes[axis][1][lane]));
                if low.x > high.x {
                    continue;
                }
                match node.children[lane].target() {
                    Target::Packet(index) => {
                        for primitive in tree.packets[index].primitives {
                            for corner in triangles[primitive as usize].1 {
                                assert!(corner.cmpgt(low).all() && corner.cmplt(high).all());
                                seen += 1;
                            }
                        }
                    }
                    Target::Node(index) => {
                        for (axis, planes) in tree.nodes[index].planes.iter().enumerate() {
                            assert!(planes[0].iter().all(|&plane| plane >= low[axis]));
                            assert!(planes[1].iter().all(|&plane| plane <= high[axis]));
                        }
                    }
                    Target::Shape(_) => unreachable!("there are none"),
                }
            }
        }
        assert!(seen >= 3 * triangles.len());
    }
}
