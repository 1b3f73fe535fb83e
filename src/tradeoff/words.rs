//! Numbers as people say them.

/// A time for a sentence: two digits.
pub(super) fn seconds(time: f64) -> String {
    let rounded = two_digits(time);
    match rounded {
        time if time >= 600.0 => format!("{:.0} min", time / 60.0),
        time if time < 0.0095 => format!("{} ms", two_digits(1000.0 * time)),
        time => format!("{time} s"),
    }
}

/// An error for a sentence: two digits.
pub(super) fn relative_l2(error: f64) -> String {
    if error >= 0.095 { two_digits(error).to_string() } else { format!("{error:.1e}") }
}

/// The number nearest with two digits that count.
fn two_digits(number: f64) -> f64 {
    format!("{number:.1e}").parse().unwrap_or(number)
}

/// How many times as much, for a sentence.
pub(super) fn factor(factor: f64) -> String {
    if factor < 10.0 { format!("{factor:.1}") } else { format!("{factor:.0}") }
}

/// `digit` times ten to the `power`, the nearest number there is.
pub(super) fn decimal(digit: u8, power: i32) -> f64 {
    format!("{digit}e{power}").parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_said_as_people_say_them() {
        let said = [0.0012, 0.05, 0.123_46, 1.0, 2.34, 12.3, 123.0, 1234.0].map(seconds);
        assert_eq!(said, ["1.2 ms", "0.05 s", "0.12 s", "1 s", "2.3 s", "12 s", "120 s", "20 min"]);
        assert_eq!([8.234, 0.1, 0.004_56].map(relative_l2), ["8.2", "0.1", "4.6e-3"]);
    }
}
