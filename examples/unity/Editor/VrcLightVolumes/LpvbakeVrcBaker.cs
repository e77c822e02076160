using UnityEditor;
using UnityEngine;
using UnityEngine.Rendering;
using VRCLightVolumes;
using VRCLightVolumes.Editor;

namespace Lpvbake
{
    /// <summary>Bakes VRC Light Volumes (3 or later, Baking Mode Custom Lightmapper): they place the cells,
    /// lpvbake lights all of them at once.</summary>
    public static class LpvbakeVrcBaker
    {
        /// <summary>Throws as LpvbakeTool.Bake; volumes are then as they were.</summary>
        public static void Bake(LightVolumeManager manager, string program, string scene, string options)
        {
            int count = manager.Editor.GetCustomProbesCount(), all = 0;
            if (count == 0)
                return;
            var positions = new Vector3[count][];
            for (int id = 0; id < count; ++id)
                all += (positions[id] = manager.Editor.GetCustomProbes(id)).Length;
            var together = new Vector3[all];
            for (int id = 0, at = 0; id < count; at += positions[id++].Length)
                positions[id].CopyTo(together, at);
            LpvbakeTool.Lit lit = LpvbakeTool.Bake(program, scene, options, together);
            for (int id = 0, at = 0; id < count; at += positions[id++].Length)
                Submit(manager, id, lit, at, positions[id].Length);
        }

        /// <summary>Of each cell the means of the colours, and the way x, y, z of each colour.</summary>
        static void Submit(LightVolumeManager manager, int id, LpvbakeTool.Lit lit, int first, int count)
        {
            var means = new Vector3[count];
            var ways = new[] { new Vector3[count], new Vector3[count], new Vector3[count] };
            var backs = new float[count];
            for (int i = 0; i < count; ++i)
            {
                SphericalHarmonicsL2 sh = lit.light[first + i];
                means[i] = new Vector3(sh[0, 0], sh[1, 0], sh[2, 0]);
                for (int c = 0; c < 3; ++c)
                    ways[c][i] = new Vector3(sh[c, 3], sh[c, 1], sh[c, 2]);
                backs[i] = lit.backs[first + i];
            }
            // The light has no noise that could be taken away.
            manager.Editor.SetCustomProbesBaked(id, means, ways[0], ways[1], ways[2], backs, false);
        }

        [MenuItem("Tools/lpvbake/Bake VRC Light Volumes")]
        static void BakeAll()
        {
            foreach (LightVolumeManager manager in Object.FindObjectsOfType<LightVolumeManager>())
                Bake(manager, LpvbakeSettings.Program, LpvbakeSettings.Scene, LpvbakeSettings.Options);
        }
    }
}
