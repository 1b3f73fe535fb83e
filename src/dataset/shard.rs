//! Parts of a data set, for many machines.

use std::str::FromStr;

/// Every `count`-th view, from view `index` on. The shards `0/n` to `(n−1)/n` have every view once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    count: u32,
}

impl Shard {
    /// All views.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// The numbers of its views among the first `total`.
    pub fn views(self, total: u32) -> impl Iterator<Item = u32> {
        (self.index..total).step_by(self.count as usize)
    }
}

impl Default for Shard {
    fn default() -> Self {
        Self::WHOLE
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.split_once('/')
            .and_then(|(index, count)| {
                Some(Self { index: index.parse().ok()?, count: count.parse().ok()? })
            })
            .filter(|shard| shard.index < shard.count)
            .ok_or_else(|| "expected I/N with I from 0 to N-1, such as 0/4".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_have_every_view_once() {
        for count in 1..6 {
            let mut all: Vec<u32> = (0..count)
                .flat_map(|index| format!("{index}/{count}").parse::<Shard>().unwrap().views(17))
                .collect();
            all.sort_unstable();
            assert_eq!(all, (0..17).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_shard_that_does_not_exist_is_refused() {
        for text in ["4/4", "0/0", "1", "a/2", "-1/2", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
