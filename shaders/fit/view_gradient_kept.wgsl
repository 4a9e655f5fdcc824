// By drawn Gaussian.
@group(0) @binding(30) var<storage, read_write> d_view: array<ViewGradient>;

fn put_view(i: u32, gradient: ViewGradient) {
    d_view[i] = gradient;
}
