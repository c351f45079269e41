//! Forward passes that are written down as they happen, so that a backward pass can follow them later.

use std::sync::{Arc, Mutex, PoisonError};

use super::forward::TileKind;
use super::passes::{Computed, Passes, Recording};

/// Forward passes over points that are asked about bit by bit, with what backward needs of each.
///
/// Whoever looks first, and learns from what turned out to be worth it, has every point computed once: see
/// [`Forward`](crate::sdf_field::Forward). Clones write to the same tape. The CPU's kernels do, GPUs' do not
/// and leave it empty.
#[derive(Clone, Debug, Default)]
pub struct Tape(Arc<Mutex<Written>>);

#[derive(Debug, Default)]
struct Written {
    recording: Option<Recording>,
    /// What forward returned, `[points, columns]`.
    out: Vec<f32>,
}

impl Tape {
    /// All that was written, a row for each point in the order in which they were asked about. Leaves the tape
    /// empty.
    #[must_use]
    pub fn finish(&self) -> TapedRows {
        let Written { recording, out } = self.with(std::mem::take);
        let Some(mut recording) = recording else {
            return TapedRows::default();
        };
        recording.pad();
        TapedRows {
            rows: (0..recording.points as u32).map(|row| (0, row)).collect(),
            tapes: vec![Finished {
                recording: Arc::new(recording),
                out: Arc::new(out),
            }],
        }
    }

    /// Appends the first `count` points of a tile, for which forward returned `out: [count, columns]`.
    pub(super) fn append(
        &self,
        kind: TileKind,
        computed: &Computed<'_>,
        count: usize,
        out: &[f32],
    ) {
        self.with(|written| {
            written.out.extend_from_slice(out);
            let recording = written
                .recording
                .get_or_insert_with(|| Recording::new(kind));
            assert_eq!(recording.kind, kind, "Tape: passes of another field");
            recording.append(computed, count);
        });
    }

    fn with<R>(&self, change: impl FnOnce(&mut Written) -> R) -> R {
        // What a panic elsewhere left half written is of rows that nobody has.
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Rows of finished [`Tape`]s of one field.
#[derive(Clone, Debug, Default)]
pub struct TapedRows {
    tapes: Vec<Finished>,
    /// Of each row: its tape, and its number there.
    rows: Vec<(u32, u32)>,
}

#[derive(Clone, Debug)]
struct Finished {
    recording: Arc<Recording>,
    /// As in [`Written`].
    out: Arc<Vec<f32>>,
}

impl TapedRows {
    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The rows with these numbers. Backward follows none of them twice.
    #[must_use]
    pub fn select(&self, chosen: &[u32]) -> Self {
        Self {
            tapes: self.tapes.clone(),
            rows: chosen.iter().map(|&i| self.rows[i as usize]).collect(),
        }
    }

    /// Appends the rows of `other`.
    pub fn append(&mut self, other: &Self) {
        let first = self.tapes.len() as u32;
        self.tapes.extend(other.tapes.iter().cloned());
        let rows = other.rows.iter();
        self.rows
            .extend(rows.map(|(tape, row)| (first + tape, *row)));
    }

    /// What forward returned for these rows, `[n, columns]`.
    ///
    /// # Panics
    /// When a tape is of a field with other outputs.
    pub(super) fn out(&self, columns: usize) -> Vec<f32> {
        for tape in &self.tapes {
            let (values, points) = (tape.out.len(), tape.recording.points);
            assert_eq!(values, columns * points, "TapedRows: of another field");
        }
        let mut out = Vec::with_capacity(columns * self.rows.len());
        for (tape, row) in &self.rows {
            let start = columns * *row as usize;
            out.extend_from_slice(&self.tapes[*tape as usize].out[start..start + columns]);
        }
        out
    }

    /// What forward left behind for these rows.
    ///
    /// # Panics
    /// When a tape is of another `kind` of field.
    pub(super) fn passes(&self, kind: TileKind) -> Passes {
        let recordings = self.tapes.iter().map(|tape| {
            assert_eq!(tape.recording.kind, kind, "TapedRows: of another field");
            Arc::clone(&tape.recording)
        });
        Passes::taped(kind, recordings.collect(), &self.rows)
    }
}
