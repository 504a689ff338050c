"""Problems and plans as files: problem files, drawings and meshes read, folders of results written and read again."""
