//! Circles in a difference picture, by votes along its gradients.

use super::change::Change;

/// How far centres may lie outside of the view, cells.
const BEYOND: usize = 12;

/// Gradients below this many standard deviations are noise.
const LEAST_GRADIENT: f32 = 4.0;

/// Gradients above this many times the least one have a whole vote.
const WHOLE_VOTE: f32 = 4.0;

/// Votes are cast along the gradient at distances this far apart, cells.
const STEP: f32 = 0.5;

/// Votes that a centre needs.
const LEAST_VOTES: f32 = 4.0;

/// Part of the votes of the first centre that further ones need.
const LEAST_SHARE: f32 = 0.3;

/// Centres are at least this far apart, cells.
const APART: usize = 3;

/// Where the centre of a darkened disc may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Column of cells, from the left edge of the first.
    pub(super) x: f32,
    /// Row of cells, from the upper edge of the first.
    pub(super) y: f32,
    /// Votes for it.
    pub(super) votes: f32,
}

/// Discs of a radius between `least_radius` and `most_radius` cells that have darkened, those with
/// most votes first, at most `limit`. Where `ignored` says so for a row and column, nothing counts.
pub(super) fn candidates(
    change: &Change,
    least_radius: f32,
    most_radius: f32,
    limit: usize,
    ignored: impl Fn(usize, usize) -> bool,
) -> Vec<Candidate> {
    let grid = change.grid;
    let stride = grid.stride();
    let inside = change.inside.and(change.inside, 1);
    let (width, height) = (grid.width + 2 * BEYOND, grid.height + 2 * BEYOND);
    let mut votes = vec![0.0_f32; width * height];
    // Sobel's weights make the deviation of a slope √12 / 8 of that of the cells.
    let least = LEAST_GRADIENT * 0.433 * change.noise;
    let steps = ((most_radius - least_radius) / STEP).ceil() as usize;
    let mut slopes = vec![(0.0_f32, 0.0_f32); grid.width];
    for j in inside.rows.0..inside.rows.1 {
        let [above, here, below] =
            [j - 1, j, j + 1].map(|j| &change.difference[j * stride..(j + 1) * stride]);
        let columns = inside.columns.0..inside.columns.1;
        for i in columns.clone() {
            let left = above[i - 1] + 2.0 * here[i - 1] + below[i - 1];
            let right = above[i + 1] + 2.0 * here[i + 1] + below[i + 1];
            let upper = above[i - 1] + 2.0 * above[i] + above[i + 1];
            let lower = below[i - 1] + 2.0 * below[i] + below[i + 1];
            slopes[i] = (0.125 * (right - left), 0.125 * (lower - upper));
        }
        for i in columns {
            let (x, y) = slopes[i];
            let squared = x * x + y * y;
            if squared <= least * least || ignored(j, i) {
                continue;
            }
            let length = squared.sqrt();
            let weight = (length / (WHOLE_VOTE * least)).min(1.0);
            // Brightness grows outwards.
            let (x, y) = (x / length, y / length);
            for k in 0..=steps {
                let radius = least_radius + STEP * k as f32;
                let column = i as f32 + 0.5 - radius * x + BEYOND as f32;
                let row = j as f32 + 0.5 - radius * y + BEYOND as f32;
                if column >= 0.0 && row >= 0.0 {
                    let (column, row) = (column as usize, row as usize);
                    if column < width && row < height {
                        votes[row * width + column] += weight;
                    }
                }
            }
        }
    }
    peaks(&votes, width, limit)
}

/// Where most votes are.
fn peaks(votes: &[f32], width: usize, limit: usize) -> Vec<Candidate> {
    let height = votes.len() / width;
    let mut around = vec![0.0_f32; votes.len()];
    for j in 1..height - 1 {
        let rows = [j - 1, j, j + 1].map(|j| &votes[j * width..(j + 1) * width]);
        for i in 1..width - 1 {
            around[j * width + i] = rows.iter().map(|row| row[i - 1] + row[i] + row[i + 1]).sum();
        }
    }
    let mut found = Vec::with_capacity(limit);
    while found.len() < limit {
        let mut best = (0, 0.0);
        for (at, &count) in around.iter().enumerate() {
            if count > best.1 {
                best = (at, count);
            }
        }
        let (at, count) = best;
        let first = found.first().map_or(count, |first: &Candidate| first.votes);
        if count < LEAST_VOTES.max(LEAST_SHARE * first) {
            break;
        }
        let (row, column) = (at / width, at % width);
        // The centre of gravity of the votes about it.
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for j in row.saturating_sub(2)..(row + 3).min(height) {
            for i in column.saturating_sub(2)..(column + 3).min(width) {
                let votes = votes[j * width + i];
                sum += votes;
                x += votes * (i as f32 + 0.5);
                y += votes * (j as f32 + 0.5);
            }
        }
        let beyond = BEYOND as f32;
        found.push(Candidate { x: x / sum - beyond, y: y / sum - beyond, votes: count });
        for j in row.saturating_sub(APART)..(row + APART + 1).min(height) {
            for i in column.saturating_sub(APART)..(column + APART + 1).min(width) {
                around[j * width + i] = 0.0;
            }
        }
    }
    found
}
