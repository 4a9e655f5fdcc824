//! [`Queue`]: the order in which the clips of a playlist play.

use std::sync::Arc;

/// A clip of a playlist, or one that was named alone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its number in the playlist, from 0.
    pub(crate) number: usize,
    /// Its path or URL; `None` for the demo.
    pub(crate) name: Option<String>,
}

impl Entry {
    /// A clip without a playlist.
    pub(crate) fn single(name: Option<String>) -> Entry {
        Entry { number: 0, name }
    }
}

/// The clips of a playlist and a position among them.
#[derive(Clone, Debug)]
pub struct Queue {
    clips: Arc<[String]>,
    position: usize,
}

impl Queue {
    /// A queue at its first clip. `clips` are paths and URLs, at least one.
    pub(crate) fn new(clips: Vec<String>) -> Queue {
        Queue { clips: clips.into(), position: 0 }
    }

    /// Number of clips.
    pub(crate) fn len(&self) -> usize {
        self.clips.len()
    }

    /// Number of the clip at the position, from 0.
    pub(crate) fn position(&self) -> usize {
        self.position
    }

    /// Moves to clip `number`.
    pub(crate) fn go_to(&mut self, number: usize) {
        self.position = number.min(self.clips.len() - 1);
    }

    /// All clips in order.
    pub(crate) fn all(&self) -> Vec<Entry> {
        (0..self.len()).map(|number| self.entry(number)).collect()
    }

    /// Candidates for the next clip, best first: the clips behind the position, then, in a `cyclic` queue, the clips
    /// before it.
    pub(crate) fn candidates(&self, cyclic: bool) -> Vec<Entry> {
        let behind = self.position + 1..self.len();
        let before = if cyclic { 0..self.position } else { 0..0 };
        behind.chain(before).map(|number| self.entry(number)).collect()
    }

    /// Candidates for the clip before, best first: the clips before the position, from it back, then the clips behind
    /// it, from the last clip back.
    pub(crate) fn candidates_before(&self) -> Vec<Entry> {
        let (before, behind) = (0..self.position, self.position + 1..self.len());
        before.rev().chain(behind.rev()).map(|number| self.entry(number)).collect()
    }

    /// Whether clip `next` plays after the clip at the position.
    pub(crate) fn is_followed_by(&self, next: usize, looping: bool) -> bool {
        looping || next > self.position
    }

    fn entry(&self, number: usize) -> Entry {
        Entry { number, name: Some(self.clips[number].clone()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(entries: &[Entry]) -> Vec<usize> {
        entries.iter().map(|entry| entry.number).collect()
    }

    #[test]
    fn a_looping_queue_starts_over_after_its_last_clip() {
        let mut queue = Queue::new(["a", "b", "c"].map(String::from).to_vec());
        assert_eq!((numbers(&queue.all()), numbers(&queue.candidates(true))), (vec![0, 1, 2], vec![1, 2]));
        queue.go_to(2);
        assert_eq!(numbers(&queue.candidates(true)), [0, 1]);
        assert!(queue.candidates(false).is_empty());
        assert!(queue.is_followed_by(0, true) && !queue.is_followed_by(0, false));
        queue.go_to(1);
        assert!(queue.is_followed_by(2, false));
        assert_eq!(numbers(&queue.candidates(true)), [2, 0]);
        assert_eq!(numbers(&queue.candidates_before()), [0, 2]);
        assert_eq!(queue.candidates(false)[0].name.as_deref(), Some("c"));
    }
}
