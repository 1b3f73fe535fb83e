//! Letters for the labels of contact sheets: three by five dots, as large as a small print.

use quietlight_denoise::Image;

/// Pixels across that a letter takes.
pub(super) const WIDTH: usize = 4 * DOT;
/// Pixels down that a line takes.
pub(super) const HEIGHT: usize = 6 * DOT;

/// Pixels along the side of a dot.
const DOT: usize = 2;

/// Five rows of three dots, the uppermost first, the leftmost the highest bit; unknown letters are a box.
fn dots(letter: char) -> [u8; 5] {
    match letter {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b011, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b010, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        'e' => [0b000, 0b111, 0b111, 0b100, 0b111],
        'k' => [0b100, 0b101, 0b110, 0b110, 0b101],
        's' => [0b000, 0b011, 0b110, 0b011, 0b110],
        't' => [0b010, 0b111, 0b010, 0b010, 0b011],
        '.' => [0b000, 0b000, 0b000, 0b000, 0b010],
        '-' => [0b000, 0b000, 0b111, 0b000, 0b000],
        ' ' => [0; 5],
        _ => [0b111; 5],
    }
}

/// Draws a line of white letters; what lies outside of the picture is not drawn.
pub(super) fn draw(picture: &mut Image, text: &str, top: usize, left: usize) {
    for (place, letter) in text.chars().enumerate() {
        for (row, bits) in dots(letter).into_iter().enumerate() {
            for column in (0..3).filter(|column| bits & (0b100 >> column) != 0) {
                for (y, x) in (0..DOT).flat_map(|y| (0..DOT).map(move |x| (y, x))) {
                    let (y, x) = (top + row * DOT + y, left + place * WIDTH + column * DOT + x);
                    for channel in 0..3 {
                        if let Some(value) = picture.get_mut([channel, y, x]) {
                            *value = 1.0;
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_drawn_where_it_belongs_and_cut_off_at_the_edge() {
        let mut picture = Image::zeros((3, 20, 20));
        draw(&mut picture, "1-1-", 2, 3);
        // The foot of the 1 is three dots across; the dash begins a letter further.
        assert_eq!(picture[[0, 11, 3]], 1.0);
        assert_eq!(picture[[2, 6, 3 + WIDTH]], 1.0);
        assert_eq!(picture[[0, 2, 3]], 0.0);
        // Eight dots, three, and of the second 1 the left half of two; the last letter lies outside.
        let drawn = picture.iter().filter(|&&value| value > 0.0).count();
        assert_eq!(drawn, 3 * (8 * 4 + 3 * 4 + 2 * 2));
    }
}
