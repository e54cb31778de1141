"""Tables of trainings and of studies of learners. They compute nothing."""
