//! A bounding volume hierarchy: eight boxes a node, eight triangles a packet.
//!
//! [`build`] makes a binary tree and collapses it, [`wide`] is the memory it lies in. [`traverse`] walks it with AVX2,
//! [`portable`] with plain arithmetic, in the same order and with the same roundings: both give the same hits, bit by
//! bit.

mod build;
mod collapse;
mod portable;
mod query;
#[cfg(target_arch = "x86_64")]
mod traverse;
mod wide;

pub(crate) use query::Query;

use super::Hit;
use super::shape::Shape;
use glam::Vec3;
use wide::{Child, Node, Packet};

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Aabb {
    pub(crate) min: Vec3,
    pub(crate) max: Vec3,
}

impl Aabb {
    /// Around nothing.
    pub(crate) const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    pub(crate) fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }
}

/// Most entries that a traversal may have to remember; trees that need more are built anew, balanced.
const STACK: usize = 256;

/// Triangles and other shapes, found by rays.
#[derive(Debug)]
pub(crate) struct Bvh {
    /// `None` when there is nothing to hit.
    root: Option<Child>,
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    shapes: Vec<(u32, Shape)>,
    /// [`portable`] is used where this is `None`.
    #[cfg(target_arch = "x86_64")]
    avx2: Option<traverse::Avx2>,
}

impl Default for Bvh {
    fn default() -> Self {
        Self::new(&[], Vec::new())
    }
}

impl Bvh {
    /// Over triangles and other shapes, each with the index that its hits carry.
    pub(crate) fn new(triangles: &[(u32, [Vec3; 3])], shapes: Vec<(u32, Shape)>) -> Self {
        let collapse::Collapsed { root, mut nodes, mut packets, .. } =
            build::build(triangles, &shapes, STACK);
        #[cfg(target_arch = "x86_64")]
        {
            nodes = traverse::in_huge_pages(nodes);
            packets = traverse::in_huge_pages(packets);
        }
        nodes.shrink_to_fit();
        packets.shrink_to_fit();
        Self {
            root,
            nodes,
            packets,
            shapes,
            #[cfg(target_arch = "x86_64")]
            avx2: traverse::Avx2::detect(),
        }
    }

    /// The nearest hit.
    #[inline]
    pub(crate) fn intersect(&self, query: &Query) -> Option<Hit> {
        let root = self.root?;
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return avx2.intersect(self, root, query);
        }
        portable::intersect(self, root, query)
    }

    /// Is there any hit?
    #[inline]
    pub(crate) fn is_occluded(&self, query: &Query) -> bool {
        let Some(root) = self.root else { return false };
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return avx2.is_occluded(self, root, query);
        }
        portable::is_occluded(self, root, query)
    }

    /// From now on without AVX2, as on another machine.
    pub(crate) fn use_portable(&mut self) {
        #[cfg(target_arch = "x86_64")]
        {
            self.avx2 = None;
        }
    }

    /// Memory of nodes, packets and shapes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.packets) + size_of_val(&*self.shapes)
    }
}
