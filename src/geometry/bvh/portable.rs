//! Traversal in plain arithmetic: what [`super::traverse`] does, lane by lane.

use super::wide::{Child, Node, Packet, Target, WIDTH};
use super::{Bvh, Query, STACK};
use crate::geometry::{Hit, triangle};

/// The nearest hit.
pub(super) fn intersect(bvh: &Bvh, root: Child, query: &Query) -> Option<Hit> {
    let mut nearest: Option<Hit> = None;
    walk(bvh, root, query, |target, t_max| {
        let hit = match target {
            Target::Packet(index) => nearest_in_packet(&bvh.packets[index], query, t_max),
            Target::Shape(index) => {
                let (primitive, shape) = &bvh.shapes[index];
                shape.intersect(query, t_max).map(|t| Hit {
                    t,
                    u: 0.0,
                    v: 0.0,
                    primitive: *primitive,
                })
            }
            Target::Node(_) => None,
        };
        if hit.is_some() {
            nearest = hit;
        }
        hit.map_or(t_max, |hit| hit.t)
    });
    nearest
}

/// Is there any hit?
pub(super) fn is_occluded(bvh: &Bvh, root: Child, query: &Query) -> bool {
    let mut is_occluded = false;
    walk(bvh, root, query, |target, t_max| {
        is_occluded |= match target {
            Target::Packet(index) => nearest_in_packet(&bvh.packets[index], query, t_max).is_some(),
            Target::Shape(index) => bvh.shapes[index].1.intersect(query, t_max).is_some(),
            Target::Node(_) => false,
        };
        if is_occluded { 0.0 } else { t_max }
    });
    is_occluded
}

/// Visits leaves, near ones first. `visit` returns how far the ray still matters.
fn walk(bvh: &Bvh, root: Child, query: &Query, mut visit: impl FnMut(Target, f32) -> f32) {
    let mut stack = [(0.0, Child::node(0)); STACK];
    let mut waiting = 0;
    let mut t_max = query.t_max;
    let mut child = root;
    loop {
        match child.target() {
            Target::Node(index) => {
                let node = &bvh.nodes[index];
                let first = waiting;
                let (entries, is_entered) = enter(node, query, Query::limit(t_max));
                for lane in 0..WIDTH {
                    if is_entered[lane] {
                        let entry = (entries[lane], node.children[lane]);
                        let mut slot = waiting;
                        while slot > first && stack[slot - 1] < entry {
                            stack[slot] = stack[slot - 1];
                            slot -= 1;
                        }
                        stack[slot] = entry;
                        waiting += 1;
                    }
                }
            }
            leaf => t_max = visit(leaf, t_max),
        }
        loop {
            if waiting == 0 {
                return;
            }
            waiting -= 1;
            if stack[waiting].0 <= Query::limit(t_max) {
                child = stack[waiting].1;
                break;
            }
        }
    }
}

/// Where the ray enters each child's box, and whether it does before `limit`.
///
/// A ray in the plane of a box with no motion across it gives 0·∞, a NaN, which `larger` and `smaller` leave out.
#[inline(always)]
fn enter(node: &Node, query: &Query, limit: f32) -> ([f32; WIDTH], [bool; WIDTH]) {
    let mut near = [0.0; WIDTH];
    let mut far = [limit; WIDTH];
    for axis in 0..3 {
        let origin = query.origin[axis];
        let planes = &node.planes[axis];
        let near_planes = &planes[query.near_plane[axis]];
        let far_planes = &planes[1 - query.near_plane[axis]];
        for lane in 0..WIDTH {
            near[lane] = larger((near_planes[lane] - origin) * query.near_rcp[axis], near[lane]);
            far[lane] = smaller((far_planes[lane] - origin) * query.far_rcp[axis], far[lane]);
        }
    }
    (near, std::array::from_fn(|lane| near[lane] <= far[lane]))
}

/// `_mm256_max_ps`: the second where the first is NaN.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// `_mm256_min_ps`: the second where the first is NaN.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Of hits at the same `t`, the first lane's.
fn nearest_in_packet(packet: &Packet, query: &Query, mut t_max: f32) -> Option<Hit> {
    let mut nearest = None;
    for lane in 0..WIDTH {
        let corners = packet.vertices.map(|corner| corner.map(|axis| axis[lane]));
        if let Some(hit) = triangle::intersect(query, &corners, t_max) {
            t_max = hit.t;
            nearest =
                Some(Hit { t: hit.t, u: hit.u, v: hit.v, primitive: packet.primitives[lane] });
        }
    }
    nearest
}
