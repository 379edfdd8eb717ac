"""Reading and writing files safely, and the forms that many of them share."""
