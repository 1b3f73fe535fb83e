//! Lines of glyphs made of random strokes: detail as fine and as structured as print, in no script at all.

use super::Field;
use crate::dataset::generator::random::Random;
use glam::DVec2;

/// Points of the lattice that strokes join: a glyph is 3 wide and 5 high.
const COLUMNS: usize = 3;
const ROWS: usize = 5;

/// A glyph: strokes between lattice points, in units of the glyph's box.
type Glyph = Vec<[DVec2; 2]>;

/// A page: a margin, at times a headline, and lines of words.
pub(super) fn field(size: usize, random: &mut Random) -> Field {
    let alphabet: Vec<Glyph> = (0..26).map(|_| glyph(random)).collect();
    let lines = random.pick(&[4, 8, 12, 16]);
    let mut page = Page { size, values: vec![0.0; size * size] };
    let line = size as f64 / lines as f64;
    let margin = random.uniform(0.02, 0.12) * size as f64;
    let mut top = margin;
    let has_headline = random.chance(0.4);
    if has_headline {
        page.line(&alphabet, random, top, 2.0 * line, margin);
        top += 2.4 * line;
    }
    while top + line < size as f64 - margin {
        if random.chance(0.92) {
            page.line(&alphabet, random, top, line, margin);
        }
        top += line;
    }
    // Ink is dark on paper; the other way round as often as signs are.
    if random.chance(0.7) {
        page.values.iter_mut().for_each(|value| *value = 1.0 - *value);
    }
    Field { size, values: page.values }
}

fn glyph(random: &mut Random) -> Glyph {
    let point = |random: &mut Random| {
        let (column, row) = (random.integer(0, COLUMNS - 1), random.integer(0, ROWS - 1));
        DVec2::new(column as f64 / (COLUMNS - 1) as f64, row as f64 / (ROWS - 1) as f64)
    };
    let mut strokes = Vec::new();
    let mut at = point(random);
    for _ in 0..random.integer(2, 5) {
        let next = point(random);
        if next != at {
            strokes.push([at, next]);
        }
        // Most strokes go on where the last one ended.
        at = if random.chance(0.7) { next } else { point(random) };
    }
    strokes
}

struct Page {
    size: usize,
    values: Vec<f32>,
}

impl Page {
    /// Words from margin to margin on a line of this height, pixels.
    fn line(
        &mut self,
        alphabet: &[Glyph],
        random: &mut Random,
        top: f64,
        height: f64,
        margin: f64,
    ) {
        let (glyph_height, glyph_width) = (0.6 * height, 0.34 * height);
        let weight = random.uniform(0.05, 0.09) * height;
        let mut left = margin;
        let mut in_word = random.integer(1, 9);
        while left + glyph_width < self.size as f64 - margin {
            if in_word == 0 {
                in_word = random.integer(1, 9);
                left += 0.6 * glyph_width;
                continue;
            }
            in_word -= 1;
            let origin = DVec2::new(left, top + 0.2 * height);
            let glyph = &alphabet[random.integer(0, alphabet.len() - 1)];
            for stroke in glyph {
                let [a, b] =
                    stroke.map(|p| origin + p * DVec2::new(glyph_width * 0.8, glyph_height));
                self.stroke(a, b, weight.max(0.6));
            }
            left += 1.15 * glyph_width;
        }
    }

    /// A line between two points, of this half-width in pixels, its edge one pixel soft.
    fn stroke(&mut self, a: DVec2, b: DVec2, half_width: f64) {
        let clamp = |value: f64| value.clamp(0.0, (self.size - 1) as f64) as usize;
        let (low, high) = (a.min(b) - half_width - 1.0, a.max(b) + half_width + 1.0);
        let along = b - a;
        for row in clamp(low.y)..=clamp(high.y) {
            for column in clamp(low.x)..=clamp(high.x) {
                let p = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) - a;
                let t = (p.dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
                let cover = (half_width - (p - along * t).length() + 0.5).clamp(0.0, 1.0) as f32;
                let value = &mut self.values[row * self.size + column];
                *value = value.max(cover);
            }
        }
    }
}
