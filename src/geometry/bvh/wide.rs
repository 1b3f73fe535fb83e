//! The tree as it lies in memory: nodes of eight boxes, packets of eight triangles.

use super::Aabb;

/// Children of a node, and triangles of a packet: one AVX2 register.
pub(crate) const WIDTH: usize = 8;

/// Lower and upper corner, one lane a child: `planes[axis][0]` are the lower, `planes[axis][1]` the upper coordinates.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    pub(crate) planes: [[[f32; WIDTH]; 2]; 3],
    pub(crate) children: [Child; WIDTH],
}

impl Node {
    /// Without children: boxes inside out, which no ray enters.
    pub(crate) const EMPTY: Self = Self {
        planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [Child(0); WIDTH],
    };

    pub(crate) fn set(&mut self, lane: usize, bounds: &Aabb, child: Child) {
        for axis in 0..3 {
            self.planes[axis][0][lane] = bounds.min[axis];
            self.planes[axis][1][lane] = bounds.max[axis];
        }
        self.children[lane] = child;
    }
}

/// Vertices of up to eight triangles, `vertices[corner][axis]`, and the index of each. When there are fewer, the last
/// one is repeated: it costs nothing and needs no mask.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Packet {
    pub(crate) vertices: [[[f32; WIDTH]; 3]; 3],
    pub(crate) primitives: [u32; WIDTH],
}

impl Packet {
    pub(crate) fn new(triangles: impl ExactSizeIterator<Item = (u32, [glam::Vec3; 3])>) -> Self {
        debug_assert!((1..=WIDTH).contains(&triangles.len()));
        let mut packet = Self { vertices: [[[0.0; WIDTH]; 3]; 3], primitives: [0; WIDTH] };
        for (lane, (primitive, corners)) in triangles.enumerate() {
            for lane in lane..WIDTH {
                packet.primitives[lane] = primitive;
                for (axes, corner) in packet.vertices.iter_mut().zip(corners) {
                    for (lanes, coordinate) in axes.iter_mut().zip(corner.to_array()) {
                        lanes[lane] = coordinate;
                    }
                }
            }
        }
        packet
    }
}

/// What a lane of a node leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(transparent)]
pub(crate) struct Child(pub(crate) u32);

/// A [`Child`], taken apart.
pub(crate) enum Target {
    Node(usize),
    Packet(usize),
    Shape(usize),
}

impl Child {
    pub(crate) const LEAF: u32 = 1 << 31;
    pub(crate) const SHAPE: u32 = 1 << 30;
    pub(crate) const INDEX: u32 = Self::SHAPE - 1;

    pub(crate) fn node(index: usize) -> Self {
        Self(Self::index(index))
    }

    pub(crate) fn packet(index: usize) -> Self {
        Self(Self::index(index) | Self::LEAF)
    }

    pub(crate) fn shape(index: usize) -> Self {
        Self(Self::index(index) | Self::LEAF | Self::SHAPE)
    }

    fn index(index: usize) -> u32 {
        u32::try_from(index)
            .ok()
            .filter(|&index| index <= Self::INDEX)
            .expect("a tree has under 2^30 nodes and packets")
    }

    #[inline(always)]
    pub(crate) fn target(self) -> Target {
        let index = (self.0 & Self::INDEX) as usize;
        if self.0 & Self::LEAF == 0 {
            Target::Node(index)
        } else if self.0 & Self::SHAPE == 0 {
            Target::Packet(index)
        } else {
            Target::Shape(index)
        }
    }
}
