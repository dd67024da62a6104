//! Memory that runs write to.

use crate::program::Program;

/// Memory that runs write to, kept from one run to the next. It grows to what the largest network
/// run with it needs and may be used with any network.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    /// Activations.
    pub(crate) buffers: Vec<Vec<f32>>,
    /// The padded input of a convolution.
    pub(crate) padded: Vec<f32>,
    /// The output of the network, channel by channel.
    pub(crate) output: Vec<f32>,
}

impl Scratch {
    /// Grows to what a program needs.
    pub(crate) fn fit(&mut self, program: &Program) {
        if self.buffers.len() < program.buffer_values.len() {
            self.buffers.resize(program.buffer_values.len(), Vec::new());
        }
        for (buffer, &values) in self.buffers.iter_mut().zip(&program.buffer_values) {
            grow(buffer, values);
        }
        grow(&mut self.padded, program.padded_values);
        grow(&mut self.output, program.output.shape.values());
    }
}

fn grow(buffer: &mut Vec<f32>, values: usize) {
    if buffer.len() < values {
        buffer.resize(values, 0.0);
    }
}
