//! How values are read from what is typed.

use super::choices::Denoiser;
use clap::ValueEnum;
use std::time::Duration;

/// Reads a [`Denoiser`] that takes noise out.
pub(super) fn denoiser() -> impl clap::builder::TypedValueParser<Value = Denoiser> {
    use clap::builder::{PossibleValuesParser, TypedValueParser};

    PossibleValuesParser::new(["auto", "bilateral", "bilateral-constant", "kpcn"])
        .try_map(|name| Denoiser::from_str(&name, false))
}

/// Reads a brightening in stops.
pub(super) fn stops(text: &str) -> Result<f32, String> {
    let stops = text.parse().ok().filter(|stops: &f32| stops.is_finite());
    stops.ok_or_else(|| format!("expected a number of stops such as -1 or 2.5, not {text:?}"))
}

/// How often something is done; `None` is never.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::cli) struct Interval(pub(in crate::cli) Option<Duration>);

/// Reads a time, or `off`.
pub(super) fn interval(text: &str) -> Result<Interval, String> {
    if text == "off" { Ok(Interval(None)) } else { time(text).map(|time| Interval(Some(time))) }
}

/// Reads a time with its unit; seconds where there is none.
pub(in crate::cli) fn time(text: &str) -> Result<Duration, String> {
    let units = [("ms", 1e-3), ("s", 1.0), ("m", 60.0), ("h", 3600.0)];
    let (number, seconds) = units
        .iter()
        .find_map(|&(unit, seconds)| Some((text.strip_suffix(unit)?, seconds)))
        .unwrap_or((text, 1.0));
    let expected = || format!("expected a time such as 30s, 2.5m or 1h, not {text:?}");
    let number: f64 = number.trim().parse().map_err(|_| expected())?;
    let time = Duration::try_from_secs_f64(number * seconds).map_err(|_| expected())?;
    if time.is_zero() { Err(expected()) } else { Ok(time) }
}

pub(super) fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("expected NAME=VALUE".to_owned()),
    }
}

pub(super) fn noise(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|noise: &f64| *noise >= 0.0 && noise.is_finite())
        .ok_or_else(|| "expected zero or a positive number, such as 0.001".to_owned())
}

pub(super) fn target(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|error: &f64| *error > 0.0 && error.is_finite())
        .ok_or_else(|| "expected a positive number, such as 0.005".to_owned())
}

pub(super) fn factor(text: &str) -> Result<f32, String> {
    text.parse()
        .ok()
        .filter(|factor: &f32| *factor >= 1.0 && factor.is_finite())
        .ok_or_else(|| "expected a number of at least 1, such as 3".to_owned())
}

pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    text.split_once('x')
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)))
        .filter(|&(width, height)| width > 0 && height > 0)
        .ok_or_else(|| "expected WIDTHxHEIGHT in pixels, such as 640x480".to_owned())
}

pub(super) fn replay(text: &str) -> Result<[u32; 3], String> {
    let numbers: Vec<u32> =
        text.split(',').map_while(|number| number.trim().parse().ok()).collect();
    numbers.try_into().map_err(|_| "expected three whole numbers: column,row,sample".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_do_not_parse_are_refused() {
        assert_eq!(size("640x480"), Ok((640, 480)));
        assert!(size("0x4").is_err() && size("640").is_err());
        assert_eq!(definition("a=b=c"), Ok(("a".to_owned(), "b=c".to_owned())));
        assert!(definition("=1").is_err() && definition("a").is_err());
        assert_eq!(replay("1, 2,3"), Ok([1, 2, 3]));
        assert!(replay("1,2").is_err() && replay("1,2,x").is_err());
    }
}
