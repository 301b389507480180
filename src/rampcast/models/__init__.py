"""What is learned: drivers, disturbance, head, merging, correction; one file each."""
