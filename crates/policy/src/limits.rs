//! What a policy file may ask for. The limits bound memory and time whatever the file says.

/// Largest policy file that is read, bytes.
pub const MAX_FILE_BYTES: usize = 256 << 20;

/// Largest manifest that is read, bytes.
pub const MAX_MANIFEST_BYTES: usize = 4 << 20;

/// Most tensors that a file may hold.
pub const MAX_TENSORS: usize = 4096;

/// Most layers that a network may have.
pub const MAX_LAYERS: usize = 1024;

/// Largest number of channels, rows or columns of any activation, and largest kernel, stride,
/// padding and dilation.
pub const MAX_DIMENSION: usize = 1 << 22;

/// Most values in one activation, its padding included.
pub const MAX_ACTIVATION_VALUES: u64 = 1 << 22;

/// Most values in all activations of a network together.
pub const MAX_NETWORK_VALUES: u64 = 1 << 25;

/// Most weights of a network after they are laid out for the kernels, which fills up the last
/// vector of output channels.
pub const MAX_PARAMETERS: u64 = 1 << 26;

/// Most multiplications of one run.
pub const MAX_MULTIPLICATIONS: u64 = 1 << 34;
