"""What others' monitoring gets, through their own libraries."""
