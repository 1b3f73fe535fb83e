//! From a binary tree to one of eight children a node, at least expected cost.
//!
//! The dynamic programme of Ylitie, Karras and Laine 2017 ("Efficient Incoherent Ray Traversal on GPUs Through Compressed
//! Wide BVHs", section 3.1), with packets of triangles as leaves. The expected cost of a subtree is the probability of
//! visiting it, proportional to the area of its box, times the cost of a visit.

use super::Aabb;
use super::build::{Binary, BinaryTree, Primitives};
use super::wide::{Child, Node, Packet, WIDTH};

/// Cost of testing the eight boxes of a node; only its ratio to [`PACKET_COST`] matters.
const NODE_COST: f32 = 1.0;

/// Cost of testing a packet of triangles or a shape.
const PACKET_COST: f32 = 1.2;

/// The wide tree.
#[derive(Default)]
pub(super) struct Collapsed {
    pub(super) root: Option<Child>,
    pub(super) nodes: Vec<Node>,
    pub(super) packets: Vec<Packet>,
    /// Most entries that a traversal has to remember.
    pub(super) stack: usize,
}

/// What is known of each binary node.
struct Programme<'a> {
    tree: &'a BinaryTree,
    triangle_count: usize,
    /// `costs[n][i]` is the least cost of subtree `n` given up to `i + 1` lanes of a wide node.
    costs: Vec<[f32; WIDTH - 1]>,
    /// How many primitives a node holds; more than [`WIDTH`] where a shape and something else are among them.
    counts: Vec<u32>,
    bounds: Vec<Aabb>,
}

/// Collapses `tree` at least expected cost.
pub(super) fn collapse(tree: &BinaryTree, primitives: &Primitives<'_>) -> Collapsed {
    let programme = Programme::solve(tree, primitives);
    let mut collapsed = Collapsed::default();
    let mut work = Vec::new();
    // A node's children are numbered before any grandchild, so that siblings lie together.
    let place = |binary: usize,
                 collapsed: &mut Collapsed,
                 work: &mut Vec<(usize, usize, usize)>,
                 stack: usize| {
        if let Some(leaf) = programme.leaf(binary) {
            match leaf.as_slice() {
                &[shape] if shape >= programme.triangle_count => {
                    Child::shape(shape - programme.triangle_count)
                }
                triangles => {
                    collapsed.packets.push(Packet::new(
                        triangles.iter().map(|&index| primitives.triangles[index]),
                    ));
                    Child::packet(collapsed.packets.len() - 1)
                }
            }
        } else {
            collapsed.nodes.push(Node::EMPTY);
            let wide = collapsed.nodes.len() - 1;
            work.push((binary, wide, stack));
            Child::node(wide)
        }
    };
    collapsed.root = Some(place(0, &mut collapsed, &mut work, 0));
    let mut lanes = Vec::with_capacity(WIDTH);
    while let Some((binary, wide, stack)) = work.pop() {
        lanes.clear();
        programme.children(binary, &mut lanes);
        collapsed.stack = collapsed.stack.max(stack + lanes.len());
        for (lane, &child) in lanes.iter().enumerate() {
            // While one child is visited, the others wait.
            let target = place(child, &mut collapsed, &mut work, stack + lanes.len() - 1);
            collapsed.nodes[wide].set(lane, &programme.bounds[child], target);
        }
    }
    collapsed
}

impl<'a> Programme<'a> {
    fn solve(tree: &'a BinaryTree, primitives: &Primitives<'_>) -> Self {
        let len = tree.nodes.len();
        let mut programme = Self {
            tree,
            triangle_count: primitives.triangles.len(),
            costs: vec![[0.0; WIDTH - 1]; len],
            counts: vec![0; len],
            bounds: vec![Aabb::EMPTY; len],
        };
        let mut order = Vec::with_capacity(len);
        let mut work = vec![0];
        while let Some(node) = work.pop() {
            order.push(node);
            if let Binary::Pair(pair) = tree.nodes[node] {
                work.extend([pair, pair + 1]);
            }
        }
        for &node in order.iter().rev() {
            programme.solve_node(node, &primitives.bounds);
        }
        programme
    }

    fn solve_node(&mut self, node: usize, primitive_bounds: &[Aabb]) {
        match self.tree.nodes[node] {
            Binary::Leaf(primitive) => {
                self.bounds[node] = primitive_bounds[primitive];
                self.counts[node] = if primitive < self.triangle_count { 1 } else { WIDTH as u32 };
                self.costs[node] = [self.leaf_cost(node); WIDTH - 1];
            }
            Binary::Pair(pair) => {
                self.bounds[node] = self.bounds[pair].union(&self.bounds[pair + 1]);
                self.counts[node] = self.counts[pair].saturating_add(self.counts[pair + 1]);
                self.costs[node][0] = self.leaf_cost(node).min(self.inner_cost(node, pair));
                for lanes in 2..WIDTH {
                    self.costs[node][lanes - 1] =
                        self.costs[node][lanes - 2].min(self.split(pair, lanes).1);
                }
            }
        }
    }

    /// As one packet or shape; infinite where it does not fit.
    fn leaf_cost(&self, node: usize) -> f32 {
        let is_one = matches!(self.tree.nodes[node], Binary::Leaf(_));
        if is_one || self.counts[node] <= WIDTH as u32 {
            self.tree.areas[node] * PACKET_COST
        } else {
            f32::INFINITY
        }
    }

    /// As a wide node over the children from `pair` on.
    fn inner_cost(&self, node: usize, pair: usize) -> f32 {
        self.split(pair, WIDTH).1 + self.tree.areas[node] * NODE_COST
    }

    /// The best way to share `lanes` between two siblings: how many for the first, and the cost.
    fn split(&self, pair: usize, lanes: usize) -> (usize, f32) {
        let mut best = (1, f32::INFINITY);
        for first in 1..lanes {
            let cost = self.costs[pair][first - 1] + self.costs[pair + 1][lanes - first - 1];
            if cost < best.1 {
                best = (first, cost);
            }
        }
        best
    }

    /// The primitives of `node` if it is cheapest as a leaf.
    fn leaf(&self, node: usize) -> Option<Vec<usize>> {
        if let Binary::Pair(pair) = self.tree.nodes[node]
            && self.inner_cost(node, pair) < self.leaf_cost(node)
        {
            return None;
        }
        let mut primitives = Vec::with_capacity(WIDTH);
        let mut work = vec![node];
        while let Some(node) = work.pop() {
            match self.tree.nodes[node] {
                Binary::Leaf(primitive) => primitives.push(primitive),
                Binary::Pair(pair) => work.extend([pair + 1, pair]),
            }
        }
        Some(primitives)
    }

    /// The binary nodes that become the children of the wide node at `node`.
    fn children(&self, node: usize, lanes: &mut Vec<usize>) {
        let Binary::Pair(pair) = self.tree.nodes[node] else {
            unreachable!("a single primitive is a leaf")
        };
        let (first, _) = self.split(pair, WIDTH);
        self.gather(pair, first, lanes);
        self.gather(pair + 1, WIDTH - first, lanes);
    }

    fn gather(&self, node: usize, mut count: usize, lanes: &mut Vec<usize>) {
        while count > 1 && self.costs[node][count - 1] == self.costs[node][count - 2] {
            count -= 1;
        }
        match self.tree.nodes[node] {
            Binary::Pair(pair) if count > 1 => {
                let (first, _) = self.split(pair, count);
                self.gather(pair, first, lanes);
                self.gather(pair + 1, count - first, lanes);
            }
            _ => lanes.push(node),
        }
    }
}
