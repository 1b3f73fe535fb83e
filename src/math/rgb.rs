//! Linear Rec. 709 colour, scene-referred: radiance, reflectance, throughput.

use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Neg, Sub};

/// Three linear Rec. 709 values. The unit is that of what they measure: radiance, or none for a reflectance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rgb {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
}

impl Rgb {
    /// All three zero.
    pub const BLACK: Self = Self::splat(0.0);
    /// All three one.
    pub const WHITE: Self = Self::splat(1.0);

    /// The colour with these components.
    pub const fn new(r: f32, g: f32, b: f32) -> Self {
        Self { r, g, b }
    }

    /// Grey of the given value.
    pub const fn splat(value: f32) -> Self {
        Self::new(value, value, value)
    }

    /// Rec. 709 luminance; the weights of the whole project are
    /// [`LUMINANCE`](quietlight_denoise::LUMINANCE).
    pub fn luminance(self) -> f32 {
        let [r, g, b] = quietlight_denoise::LUMINANCE;
        r * self.r + g * self.g + b * self.b
    }

    /// The largest of the three.
    pub fn max_component(self) -> f32 {
        self.r.max(self.g).max(self.b)
    }

    /// Arithmetic mean of the three.
    pub fn mean(self) -> f32 {
        (self.r + self.g + self.b) * (1.0 / 3.0)
    }

    /// Are all three neither NaN nor infinite?
    pub fn is_finite(self) -> bool {
        self.r.is_finite() && self.g.is_finite() && self.b.is_finite()
    }

    /// Are all three exactly zero?
    pub fn is_black(self) -> bool {
        self.r == 0.0 && self.g == 0.0 && self.b == 0.0
    }

    /// `f` of each component.
    pub fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Self::new(f(self.r), f(self.g), f(self.b))
    }

    /// Each component limited to `[low, high]`.
    pub fn clamp(self, low: f32, high: f32) -> Self {
        self.map(|value| value.clamp(low, high))
    }

    /// `self` where `t` is 0, `other` where `t` is 1.
    pub fn lerp(self, other: Self, t: f32) -> Self {
        self * (1.0 - t) + other * t
    }

    /// Red, green, blue.
    pub const fn to_array(self) -> [f32; 3] {
        [self.r, self.g, self.b]
    }
}

impl From<[f32; 3]> for Rgb {
    fn from([r, g, b]: [f32; 3]) -> Self {
        Self::new(r, g, b)
    }
}

impl Add for Rgb {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.r + other.r, self.g + other.g, self.b + other.b)
    }
}

impl Sub for Rgb {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.r - other.r, self.g - other.g, self.b - other.b)
    }
}

impl Mul for Rgb {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self::new(self.r * other.r, self.g * other.g, self.b * other.b)
    }
}

impl Div for Rgb {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        Self::new(self.r / other.r, self.g / other.g, self.b / other.b)
    }
}

impl Mul<f32> for Rgb {
    type Output = Self;
    fn mul(self, scale: f32) -> Self {
        Self::new(self.r * scale, self.g * scale, self.b * scale)
    }
}

impl Mul<Rgb> for f32 {
    type Output = Rgb;
    fn mul(self, colour: Rgb) -> Rgb {
        colour * self
    }
}

impl Div<f32> for Rgb {
    type Output = Self;
    fn div(self, divisor: f32) -> Self {
        Self::new(self.r / divisor, self.g / divisor, self.b / divisor)
    }
}

impl Neg for Rgb {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.r, -self.g, -self.b)
    }
}

impl AddAssign for Rgb {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl MulAssign for Rgb {
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl MulAssign<f32> for Rgb {
    fn mul_assign(&mut self, scale: f32) {
        *self = *self * scale;
    }
}

impl Sum for Rgb {
    fn sum<I: Iterator<Item = Self>>(colours: I) -> Self {
        colours.fold(Self::BLACK, Add::add)
    }
}

impl Index<usize> for Rgb {
    type Output = f32;
    fn index(&self, channel: usize) -> &f32 {
        match channel {
            0 => &self.r,
            1 => &self.g,
            2 => &self.b,
            _ => panic!("an Rgb has channels 0, 1 and 2, not {channel}"),
        }
    }
}
