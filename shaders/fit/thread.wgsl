// The thread index of kernels whose groups are dispatched in two dimensions.

struct Invocation {
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
}

// Index of the thread among all threads of the dispatch.
fn thread(at: Invocation) -> u32 {
    return (at.group.y * at.groups.x + at.group.x) * GROUP + at.local;
}
