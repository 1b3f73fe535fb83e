//! Parts of work, for many machines.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Every `count`-th view, sample or chain, from number `index` on. The shards `0/n` to `(n−1)/n` have each of them once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    index: u32,
    count: u32,
}

impl Shard {
    /// All of them.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Its index, from 0.
    pub fn index(self) -> u32 {
        self.index
    }

    /// How many shards there are.
    pub fn count(self) -> u32 {
        self.count
    }

    /// Is that number one of its own?
    pub fn has(self, number: u64) -> bool {
        number % u64::from(self.count) == u64::from(self.index)
    }

    /// How many of the first `total` numbers are its own.
    pub fn share(self, total: u32) -> u32 {
        total.saturating_sub(self.index).div_ceil(self.count)
    }

    /// The number that is its own after `before` of its own.
    pub fn number(self, before: u32) -> u32 {
        self.index + before * self.count
    }

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

impl fmt::Display for Shard {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}/{}", self.index, self.count)
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
            for index in 0..count {
                let shard = Shard { index, count };
                let own: Vec<u32> = (0..shard.share(17)).map(|k| shard.number(k)).collect();
                assert_eq!(own, shard.views(17).collect::<Vec<_>>());
                assert!(own.iter().all(|&number| shard.has(number.into())));
            }
        }
    }

    #[test]
    fn a_shard_that_does_not_exist_is_refused() {
        for text in ["4/4", "0/0", "1", "a/2", "-1/2", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
