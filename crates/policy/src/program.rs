//! The steps of a network in order, and which buffer holds which activation.

use std::collections::HashMap;

use crate::PolicyError;
use crate::activation::Activation;
use crate::instructions::Instructions;
use crate::limits::{MAX_MULTIPLICATIONS, MAX_NETWORK_VALUES, MAX_PARAMETERS};
use crate::manifest::{INPUT_NAME, Layer, Manifest};
use crate::shape::Shape;
use crate::step::Step;
use crate::tensors::Tensors;

/// A buffer and the shape of what it holds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// Index of the buffer.
    pub(crate) buffer: usize,
    /// Shape of the activation.
    pub(crate) shape: Shape,
}

/// A step with its places.
#[derive(Debug)]
pub(crate) struct PlacedStep {
    /// The step.
    pub(crate) step: Step,
    /// What it reads.
    pub(crate) inputs: Vec<Place>,
    /// What it writes; the place of the first input when the step is done in place.
    pub(crate) output: Place,
}

/// A network ready to run.
#[derive(Debug)]
pub(crate) struct Program {
    /// The steps in order.
    pub(crate) steps: Vec<PlacedStep>,
    /// Where the input goes.
    pub(crate) input: Place,
    /// Where the output lies in the end.
    pub(crate) output: Place,
    /// Values in each buffer.
    pub(crate) buffer_values: Vec<usize>,
    /// Values of the largest padded input.
    pub(crate) padded_values: usize,
    /// Weights and biases as laid out.
    pub(crate) parameters: u64,
    /// Multiplications of one run.
    pub(crate) multiplications: u64,
}

/// A step before it has places: activations are numbered, 0 is the input of the network.
struct NumberedStep {
    step: Step,
    inputs: Vec<usize>,
    output: usize,
}

impl Program {
    /// Prepares all layers of a manifest.
    pub(crate) fn new(
        manifest: &Manifest,
        tensors: &Tensors<'_>,
        instructions: Instructions,
    ) -> Result<Self, PolicyError> {
        manifest.input.check(INPUT_NAME)?;
        let wiring = wire(&manifest.layers)?;
        let mut uses = vec![0_usize; manifest.layers.len() + 1];
        for &input in wiring.iter().flatten() {
            uses[input] += 1;
        }
        // The last layer gives the output.
        uses[manifest.layers.len()] += 1;
        if let Some((layer, _)) =
            manifest.layers.iter().zip(&uses[1..]).find(|(_, uses)| **uses == 0)
        {
            return Err(PolicyError::UnusedLayer { layer: layer.name.clone() });
        }

        let mut shapes = vec![manifest.input];
        // An activation that a ReLU fused into its convolution has the number of the convolution.
        let mut numbers = vec![0];
        let mut steps: Vec<NumberedStep> = Vec::new();
        let mut budget = Budget::default();
        for (layer, sources) in manifest.layers.iter().zip(&wiring) {
            let inputs: Vec<Shape> = sources.iter().map(|&source| shapes[source]).collect();
            let (step, shape) =
                Step::new(&layer.name, &layer.operation, &inputs, tensors, instructions)?;
            budget.spend(&layer.name, &step, inputs.len(), shape)?;
            shapes.push(shape);
            if let (Step::Activation(Activation::Relu), &[source]) = (&step, sources.as_slice())
                && uses[source] == 1
                && let Some(NumberedStep { step: Step::Convolution(convolution), output, .. }) =
                    steps.iter_mut().find(|earlier| earlier.output == numbers[source])
            {
                convolution.rectify();
                numbers.push(*output);
                continue;
            }
            let inputs = sources.iter().map(|&source| numbers[source]).collect();
            numbers.push(numbers.len());
            steps.push(NumberedStep { step, inputs, output: numbers.len() - 1 });
        }
        let last = numbers.last().copied().unwrap_or(0);
        Ok(place(steps, &shapes, last, &budget))
    }
}

/// Sums up what a network needs.
#[derive(Default)]
struct Budget {
    parameters: u64,
    multiplications: u64,
    values: u64,
    padded_values: usize,
}

impl Budget {
    /// Adds a step; [`PolicyError::TooLarge`] where that goes beyond a limit.
    fn spend(
        &mut self,
        layer: &str,
        step: &Step,
        inputs: usize,
        shape: Shape,
    ) -> Result<(), PolicyError> {
        let padded = step.padded_values();
        self.parameters += step.parameters();
        self.multiplications =
            self.multiplications.saturating_add(step.multiplications(inputs, shape));
        self.values += (shape.values() + padded) as u64;
        self.padded_values = self.padded_values.max(padded);
        for (what, value, limit) in [
            ("weights", self.parameters, MAX_PARAMETERS),
            ("multiplications of a run", self.multiplications, MAX_MULTIPLICATIONS),
            ("values of all activations", self.values, MAX_NETWORK_VALUES),
        ] {
            if value > limit {
                return Err(PolicyError::TooLarge { layer: layer.to_owned(), what, value, limit });
            }
        }
        Ok(())
    }
}

/// What each layer reads: 0 for the input of the network, n for layer n − 1.
fn wire(layers: &[Layer]) -> Result<Vec<Vec<usize>>, PolicyError> {
    let mut numbers = HashMap::from([(INPUT_NAME, 0)]);
    let mut wiring = Vec::with_capacity(layers.len());
    for (index, layer) in layers.iter().enumerate() {
        let mut sources = Vec::with_capacity(layer.inputs.len().max(1));
        for name in &layer.inputs {
            let number = numbers.get(name.as_str()).copied();
            sources.push(number.ok_or_else(|| PolicyError::UnknownInput {
                layer: layer.name.clone(),
                input: name.clone(),
            })?);
        }
        if layer.inputs.is_empty() {
            sources.push(index);
        }
        if numbers.insert(&layer.name, index + 1).is_some() {
            return Err(PolicyError::DuplicateLayer { layer: layer.name.clone() });
        }
        wiring.push(sources);
    }
    Ok(wiring)
}

/// Gives each activation a buffer that nothing else needs meanwhile.
fn place(steps: Vec<NumberedStep>, shapes: &[Shape], last: usize, budget: &Budget) -> Program {
    let mut last_use = vec![0; shapes.len()];
    for (index, step) in steps.iter().enumerate() {
        for &input in &step.inputs {
            last_use[input] = index;
        }
    }
    last_use[last] = steps.len();

    let input = Place { buffer: 0, shape: shapes[0] };
    let mut places = vec![input; shapes.len()];
    let mut buffer_values = vec![shapes[0].values()];
    let mut free: Vec<usize> = Vec::new();
    let mut placed = Vec::with_capacity(steps.len());
    for (index, NumberedStep { step, inputs, output }) in steps.into_iter().enumerate() {
        let shape = shapes[output];
        let mut ending: Vec<usize> =
            inputs.iter().copied().filter(|&input| last_use[input] == index).collect();
        ending.sort_unstable();
        ending.dedup();
        let first = inputs[0];
        let in_place = step.is_in_place()
            && last_use[first] == index
            && inputs.iter().filter(|&&input| input == first).count() == 1;
        let buffer = if in_place {
            ending.retain(|&input| input != first);
            places[first].buffer
        } else {
            free.pop().unwrap_or(buffer_values.len())
        };
        if buffer == buffer_values.len() {
            buffer_values.push(0);
        }
        buffer_values[buffer] = buffer_values[buffer].max(shape.values());
        places[output] = Place { buffer, shape };
        free.extend(ending.iter().map(|&input| places[input].buffer));
        let inputs = inputs.iter().map(|&input| places[input]).collect();
        placed.push(PlacedStep { step, inputs, output: places[output] });
    }
    Program {
        steps: placed,
        input,
        output: places[last],
        buffer_values,
        padded_values: budget.padded_values,
        parameters: budget.parameters,
        multiplications: budget.multiplications,
    }
}
