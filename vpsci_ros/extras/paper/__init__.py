"""The paper's studies (Tables 3, 5, 9), its Turing test, and its authors' published file formats."""
