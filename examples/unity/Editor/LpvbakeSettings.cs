using UnityEditor;

namespace Lpvbake
{
    /// <summary>Tools > lpvbake > Settings: what the bridges call. Kept by the editor.</summary>
    public class LpvbakeSettings : EditorWindow
    {
        public static string Program
        {
            get { return EditorPrefs.GetString("lpvbake.program", "lpvbake"); }
            set { EditorPrefs.SetString("lpvbake.program", value); }
        }
        /// <summary>The scene as glTF.</summary>
        public static string Scene
        {
            get { return EditorPrefs.GetString("lpvbake.scene", ""); }
            set { EditorPrefs.SetString("lpvbake.scene", value); }
        }
        /// <summary>As `lpvbake bake --help` has them: --sky, --sun, --bounces, ...</summary>
        public static string Options
        {
            get { return EditorPrefs.GetString("lpvbake.options", ""); }
            set { EditorPrefs.SetString("lpvbake.options", value); }
        }

        [MenuItem("Tools/lpvbake/Settings")]
        static void Open()
        {
            GetWindow<LpvbakeSettings>("lpvbake");
        }

        void OnGUI()
        {
            Program = EditorGUILayout.TextField("Program", Program);
            Scene = EditorGUILayout.TextField("Scene (.glb, .gltf)", Scene);
            Options = EditorGUILayout.TextField("Options", Options);
        }
    }
}
