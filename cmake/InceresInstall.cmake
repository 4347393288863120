# Install and export rules: see the helper of this file's name.
