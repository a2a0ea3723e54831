//! Parts of a file that are in memory.

use std::collections::BTreeMap;
use std::ops::Range;

/// Pieces of a file by their offset; they neither touch nor overlap.
#[derive(Debug, Default)]
pub(super) struct FilePieces(BTreeMap<u64, Vec<u8>>);

impl FilePieces {
    /// Bytes of a range if all of it is there.
    pub(super) fn get(&self, range: &Range<u64>) -> Option<&[u8]> {
        let (start, piece) = self.0.range(..=range.start).next_back()?;
        let skipped = usize::try_from(range.start - start).ok()?;
        piece.get(skipped..)?.get(..usize::try_from(range.end - range.start).ok()?)
    }

    /// Parts of a range that are not there, in order.
    pub(super) fn missing_ranges(&self, range: Range<u64>) -> Vec<Range<u64>> {
        let mut missing = Vec::new();
        let mut at = range.start;
        let before = self.0.range(..=at).next_back().map(|(start, _)| *start).unwrap_or(at);
        for (start, piece) in self.0.range(before..range.end) {
            if *start > at {
                missing.push(at..*start);
            }
            at = at.max(start + piece.len() as u64);
        }
        if at < range.end {
            missing.push(at..range.end);
        }
        missing
    }

    /// Adds a piece of a range that was missing ([`FilePieces::missing_ranges`]).
    pub(super) fn insert(&mut self, offset: u64, bytes: Vec<u8>) {
        let end = offset + bytes.len() as u64;
        let after = self.0.remove(&end);
        let piece = match self.0.range_mut(..offset).next_back() {
            Some((start, piece)) if start + piece.len() as u64 == offset => {
                piece.extend_from_slice(&bytes);
                piece
            }
            _ => self.0.entry(offset).or_insert(bytes),
        };
        if let Some(after) = after {
            piece.extend_from_slice(&after);
        }
    }

    /// Removes a range that is there and returns its bytes; a whole piece is not copied.
    pub(super) fn take(&mut self, range: &Range<u64>) -> Option<Vec<u8>> {
        let length = self.get(range)?.len();
        if self.0.get(&range.start).is_some_and(|piece| piece.len() == length) {
            return self.0.remove(&range.start);
        }
        let bytes = self.get(range)?.to_vec();
        self.discard(range);
        Some(bytes)
    }

    /// Frees what is there of a range; returns the number of bytes freed.
    pub(super) fn discard(&mut self, range: &Range<u64>) -> u64 {
        if range.is_empty() {
            return 0;
        }
        let first = self.0.range(..=range.start).next_back().map_or(range.start, |(start, _)| *start);
        let touched: Vec<u64> = self.0.range(first..range.end.max(first)).map(|(start, _)| *start).collect();
        let mut freed = 0;
        for start in touched {
            let Some(mut piece) = self.0.remove(&start) else { continue };
            let length = piece.len() as u64;
            let from = range.start.saturating_sub(start).min(length);
            let until = range.end.saturating_sub(start).min(length);
            if until < length {
                self.0.insert(start + until, piece.split_off(until as usize));
            }
            if from > 0 {
                piece.truncate(from as usize);
                self.0.insert(start, piece);
            }
            freed += until - from;
        }
        freed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_those_of_a_plain_model() {
        let mut state = 7u64;
        let mut random = |bound: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % bound
        };
        let mut pieces = FilePieces::default();
        let mut present = [false; 64];
        for _ in 0..4000 {
            let start = random(64);
            let range = start..start + random(64 - start + 1);
            let bytes: Vec<u8> = range.clone().map(|at| at as u8).collect();
            let indices = range.start as usize..range.end as usize;
            let held = present[indices.clone()].iter().filter(|present| **present).count() as u64;
            let is_whole = held == range.end - range.start;
            match random(3) {
                0 => {
                    for missing in pieces.missing_ranges(range.clone()) {
                        pieces.insert(missing.start, missing.map(|at| at as u8).collect());
                    }
                    present[indices].fill(true);
                }
                1 => {
                    assert_eq!(pieces.discard(&range), held);
                    present[indices].fill(false);
                }
                _ if is_whole && !range.is_empty() => {
                    assert_eq!(pieces.take(&range), Some(bytes));
                    present[indices].fill(false);
                }
                _ if !range.is_empty() => assert_eq!(pieces.get(&range), None),
                _ => {}
            }
            for (at, present) in (0..).zip(present) {
                assert_eq!(pieces.get(&(at..at + 1)), present.then_some(&[at as u8][..]));
            }
        }
    }
}
