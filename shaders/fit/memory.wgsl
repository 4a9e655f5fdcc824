// What is remembered of each Gaussian from step to step.

struct Memory {
    // Sum of the pulls since the last control of their number, and how many pictures showed it since.
    pull: f32,
    pictures: u32,
    // How many gradients it has had.
    visits: u32,
    // 1 where the gradient of this step can be used, else 0.
    is_usable: u32,
}
